"""Links to a gripper, of any make and on any bus: repeated reads, reports of failures, deadlines."""

from collections.abc import Callable, Iterator
from typing import TypeVar

from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import LinkError, LinkTimeout, read_late
from drivers.ports import Report
from drivers.stream import StalledError, Stream

DRAIN_S = 0.2  # wall; longest wait for pending data to end
READ_TRIES = 3  # as Robotiq's SDK: the link is down after 3 failures in a row
Read = TypeVar("Read")


class ReportingLink:
    """Base class of links: repeats reads, and reports incidents such as repeated or failed requests.

    Each report is ("link", {"incident": ..., "transaction": ..., ...}).
    """

    def __init__(self, endpoint: str, report: Report) -> None:
        self.endpoint = endpoint
        self._report = report
        self._transactions = 0
        self._lost = ""  # why the link cannot be used any more

    def _begin(self) -> None:
        if self._lost:
            raise LinkError(f"gripper link {self.endpoint} is closed: {self._lost}")
        self._transactions += 1

    def _repeated(self, read: Callable[[], Read]) -> Read:
        for attempt in range(1, READ_TRIES):
            try:
                return read()
            except LinkTimeout:
                self._tell("read repeated", attempt=attempt)
        return read()

    def _tell(self, incident: str, **details: object) -> None:
        self._report("link", {"incident": incident, "transaction": self._transactions, **details})


class StreamLink(ReportingLink):
    """A link over a stream, which `close` closes."""

    def __init__(self, stream: Stream, pace: Pace, report: Report) -> None:
        super().__init__(stream.endpoint, report)
        self._stream = stream
        self._pace = pace
        self._late_s = 0.0  # how much too late the last answer was read

    def close(self) -> None:
        """Disconnects, and commands nothing.

        A Robotiq gripper on Modbus TCP stops its fingers when the connection closes ([M200] p66).
        """
        self._stream.close()
        self._lost = self._lost or "it was closed"

    def _drain(self, quiet_s: float = 0.0) -> None:
        """Discards pending data, so that a late answer is not taken for the answer to the next request.

        Ends after a silence of `quiet_s`, or after `DRAIN_S` at most.
        """
        until = self._pace.now() + DRAIN_S
        while self._stream.receive(quiet_s) and self._pace.now() < until:
            pass

    def _pieces(self, seconds: float = 0.0) -> Iterator[bytes]:
        """Yields data as it is received until the transaction's deadline, and then during a few more reads.

        The deadline is `LINK_TIMEOUT_S` plus `seconds` of device time from now. The reads after it receive
        data that arrived in time while this process was stopped.
        """
        deadline = self._pace.now() + LINK_TIMEOUT_S + seconds / self._pace.time_scale
        for left in self._pace.looks(deadline):
            piece = self._stream.receive(max(left, 0.0))
            self._late_s = max(self._pace.now() - deadline, 0.0)
            yield piece

    def _check_in_time(self) -> None:
        """Raises a LinkTimeout if the last answer was read too late.

        Only readings are checked, since they become outdated; the answer to a write stays valid.
        """
        if self._late_s > 0.0:
            raise LinkTimeout(f"gripper at {self.endpoint} {read_late(self._late_s)}")

    def _broken(self, error: OSError, suspects: str) -> LinkError:
        # Never reopened automatically: another device may be there now.
        self._lost = "the connection broke"
        self._stream.close()
        self._tell("connection broke", error=str(error))
        if isinstance(error, StalledError):
            return LinkError(f"gripper link {self.endpoint}: {error.strerror}; check {suspects}")
        return LinkError(f"gripper link {self.endpoint} broke; check {suspects}")
