"""The one place where the server's thread and the run meet: a station behind a lock."""

import queue
import threading
from contextlib import suppress
from math import degrees

from runtime.devices.clock import SystemClock
from runtime.plc.handshake import State
from runtime.plc.registers import OUTCOMES, UNKNOWN
from runtime.plc.station import FAULT, Answer, Order, Refusal, Station
from runtime.table import Leaf, Table
from runtime.traversal.results import Outcome, PartResult

TURNED_OVER = ", turned over"  # at the end of a hypothesis' name: the part lies on its other face
_CODES = {
    Outcome.LEAF: OUTCOMES.index("located"),
    Outcome.REJECT: OUTCOMES.index("rejected"),
    Outcome.UNRESOLVED: OUTCOMES.index("unresolved"),
}


class Exchange:
    """A station that two threads use; heartbeats are in the seconds of `clock`, which is a real one."""

    def __init__(self, station: Station, clock: SystemClock) -> None:
        self._station, self._clock = station, clock
        self._lock = threading.Lock()
        self.connected = False  # whether there is a client that may write
        # Waited on in place of a condition: a stop request may end the wait, and must leave no lock behind.
        self._news: queue.SimpleQueue[None] = queue.SimpleQueue()

    # -- the server's side ----------------------------------------------------------------------------

    def read(self, address: int, count: int) -> list[int] | Refusal:
        """As `Station.read`."""
        with self._lock:
            return self._station.read(address, count, self._clock.now())

    def write(self, address: int, values: list[int]) -> Refusal | None:
        """As `Station.write`."""
        with self._lock:
            refusal = self._station.write(address, values, self._clock.now())
        if self._news.empty():
            self._news.put(None)
        return refusal

    def connect(self) -> None:
        """A client may write from now on."""
        self.connected = True

    def disconnect(self) -> None:
        """As `Station.disconnect`."""
        with self._lock:
            self._station.disconnect()
        self.connected = False
        self._news.put(None)

    # -- the run's side -------------------------------------------------------------------------------

    @property
    def order(self) -> Order | None:
        """The part that was asked for and has not ended."""
        with self._lock:
            return self._station.order

    @property
    def enabled(self) -> bool:
        """Whether triggers count, as far as the last access tells."""
        with self._lock:
            return self._station.enabled

    @property
    def state(self) -> State:
        """Where the handshake stands."""
        with self._lock:
            return self._station.state

    def wait(self, seconds: float) -> None:
        """Wait until the PLC writes something, at most so many seconds."""
        with suppress(queue.Empty):
            self._news.get(timeout=max(seconds, 0.0))

    def finish(self, answer: Answer, seconds: float | None = None) -> None:
        """As `Station.finish`; nothing without a part under way."""
        with self._lock:
            if self._station.order is not None:
                self._station.finish(answer, seconds)

    def end(self) -> None:
        """As `Station.end`."""
        with self._lock:
            self._station.end()


def answer_of(table: Table, result: PartResult) -> Answer:
    """A part's result in the units of the registers."""
    outcome = _CODES.get(result.outcome, FAULT)
    if result.outcome is not Outcome.LEAF or result.leaf is None:
        return Answer(outcome, result.exit_code)
    leaf = table.leaves[result.leaf]
    part, face = _part_and_face(table, leaf)
    return Answer(
        outcome,
        result.exit_code,
        leaf.x_um,
        leaf.y_um,
        round(1e4 * degrees(leaf.theta_urad / 1e6)),
        part,
        face,
        _error(leaf, leaf.error_median_um),
        _error(leaf, leaf.error_p95_um),
    )


def _error(leaf: Leaf, error_um: int) -> int:
    return min(error_um, UNKNOWN) if leaf.trials else UNKNOWN


def _part_and_face(table: Table, leaf: Leaf) -> tuple[int, int]:
    """Number of the part among those of the job, and which face it lies on."""
    if not table.hypotheses:
        return 0, 0
    names = [hypothesis.name for hypothesis in table.hypotheses]
    parts = list(dict.fromkeys(name.removesuffix(TURNED_OVER) for name in names))
    name = names[leaf.hypothesis]
    return parts.index(name.removesuffix(TURNED_OVER)), int(name.endswith(TURNED_OVER))
