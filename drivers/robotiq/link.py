"""What every bus to the gripper offers, and the count of what went wrong on it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, TypeVar

from drivers.errors import LinkError, LinkTimeout, ReadOnlyError

READ_TRIES = 3  # as the SDK: the link is down after 3 failures in a row
Report = Callable[[str, Mapping[str, object]], None]
Read = TypeVar("Read")


@dataclass(slots=True)
class LinkCounters:
    """What a link has been through.

    Attributes:
        transactions: requests sent.
        timeouts: those without a valid answer.
        retries: readings asked for again.
        stray_bytes: noise, echoes and late answers that were thrown away.
    """

    transactions: int = 0
    timeouts: int = 0
    retries: int = 0
    stray_bytes: int = 0


class Link(Protocol):
    """The two register blocks, on whatever bus."""

    endpoint: str
    counters: LinkCounters

    def read(self) -> bytes:
        """The input block, 6 bytes; may repeat itself.

        Raises:
            LinkTimeout: no valid answer. LinkError: the connection is gone.
        """

    def write(self, block: bytes) -> None:
        """Write the output block, 6 bytes, exactly once.

        Raises:
            LinkTimeout: whether it arrived is unknown. LinkError: the connection is gone.
        """

    def close(self) -> None:
        """Give the link up without moving anything."""


def no_report(kind: str, fields: Mapping[str, object]) -> None:
    """A report nobody reads."""


class ReportingLink:
    """Base of the links: counts and reports what goes wrong, and repeats reads.

    Args:
        endpoint: the port as the user named it.
        report: told of every retry and failure, as ("link", {"incident": ..., ...}).
    """

    def __init__(self, endpoint: str, report: Report) -> None:
        self.endpoint = endpoint
        self.counters = LinkCounters()
        self._report = report
        self._lost = ""  # why the link cannot be used any more

    def _check_open(self) -> None:
        if self._lost:
            raise LinkError(f"gripper link {self.endpoint} is closed: {self._lost}", self.endpoint)

    def _repeated(self, read: Callable[[], Read]) -> Read:
        for attempt in range(1, READ_TRIES):
            try:
                return read()
            except LinkTimeout:
                self.counters.retries += 1
                self._tell("read repeated", attempt=attempt)
        return read()

    def _tell(self, incident: str, **details: object) -> None:
        self._report("link", {"incident": incident, "transaction": self.counters.transactions, **details})


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
