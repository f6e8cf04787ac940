"""Interface of every bus to a Robotiq gripper."""

from typing import Protocol


class Link(Protocol):
    """The two register blocks, on any bus.

    In both directions a LinkTimeout means that there was no valid answer, and any other LinkError that the
    connection is gone or the device refuses.
    """

    endpoint: str

    def read(self) -> bytes:
        """Reads the input block, 6 bytes; may retry."""

    def write(self, block: bytes) -> None:
        """Writes the output block, 6 bytes, exactly once; after a timeout its arrival is unknown."""

    def close(self) -> None:
        """Closes the link without moving anything."""
