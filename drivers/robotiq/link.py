"""What every bus to a Robotiq gripper offers."""

from typing import Protocol


class Link(Protocol):
    """The two register blocks, on whatever bus.

    Both ways a LinkTimeout says that there was no valid answer, and any other LinkError that the connection
    is gone or the device refuses.
    """

    endpoint: str

    def read(self) -> bytes:
        """The input block, 6 bytes; may repeat itself."""

    def write(self, block: bytes) -> None:
        """Write the output block, 6 bytes, exactly once; whether it arrived is unknown after a timeout."""

    def close(self) -> None:
        """Give the link up without moving anything."""
