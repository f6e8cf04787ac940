"""What every bus to the gripper offers, and the count of what went wrong on it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

Report = Callable[[str, Mapping[str, object]], None]


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
        ...

    def write(self, block: bytes) -> None:
        """Write the output block, 6 bytes, exactly once.

        Raises:
            LinkTimeout: whether it arrived is unknown. LinkError: the connection is gone.
        """
        ...

    def close(self) -> None:
        """Give the link up without moving anything."""
        ...


def no_report(kind: str, fields: Mapping[str, object]) -> None:
    """A report nobody reads."""
