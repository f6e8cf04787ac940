"""A link that cannot write: what a dry run is given, so that no flag further up has to be believed."""

from drivers.errors import ReadOnlyError
from drivers.robotiq.link import Link


class ReadOnlyLink:
    """The two register blocks without a way to write; the frames of a write are never built.

    Args:
        link: the link to read through; owned from now on.
    """

    def __init__(self, link: Link) -> None:
        self.endpoint, self.counters = link.endpoint, link.counters
        self._link = link

    def read(self) -> bytes:
        """The input block, 6 bytes."""
        return self._link.read()

    def write(self, block: bytes) -> None:
        """Refuse.

        Raises:
            ReadOnlyError: always.
        """
        raise ReadOnlyError(f"a dry run was about to write {block.hex()} to the gripper at {self.endpoint}")

    def close(self) -> None:
        """Give the link up without moving anything."""
        self._link.close()
