"""The exchange: passes orders and answers between a PLC's server, in a thread of its own, and the run."""

import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from math import degrees, nan

from runtime.devices.clock import SystemClock
from runtime.plc.registers import OUTCOMES, UNKNOWN
from runtime.plc.station import Answer, Glance, Refusal, Station
from runtime.table import Leaf, Table
from runtime.traversal.results import Outcome, PartResult

TURNED_OVER = ", turned over"  # suffix of a hypothesis' name, for a part that lies turned over
_NAMES = {Outcome.LEAF: "located", Outcome.REJECT: "rejected", Outcome.UNRESOLVED: "unresolved"}


class Exchange:
    """A PLC's station with a lock, so that the server's thread and the run's thread can both use it.

    Args:
        station: the PLC's registers and handshake.
        clock: a clock of real time, for the heartbeats and for the servers' deadlines.

    Attributes:
        watch: function that is called with each new visible state of the station (`Glance`), in order. The
            thread that changes the state calls the function, which must not block.
        connected: whether there is a client that may write.
    """

    def __init__(self, station: Station, clock: SystemClock) -> None:
        self._station, self.clock = station, clock
        self._lock = threading.Lock()
        self._seen = station.glance
        self.watch: Callable[[Glance], None] = lambda _: None
        self.connected = False
        # A queue, not a condition variable: a stop request may end the wait, and must leave no lock behind.
        self._news: queue.SimpleQueue[None] = queue.SimpleQueue()

    # -- the server's side ----------------------------------------------------------------------------

    def read(self, address: int, count: int) -> list[int] | Refusal:
        """Reads registers for a client; returns their words or a refusal, see `Station.read`."""
        with self._step() as station:
            return station.read(address, count, self.clock.now())

    def write(self, address: int, values: list[int]) -> Refusal | None:
        """Writes registers for a client and wakes the run; returns a refusal or None, see `Station.write`."""
        with self._step() as station:
            refusal = station.write(address, values, self.clock.now())
        self._wake()
        return refusal

    def put(self, *steps: Mapping[str, int]) -> Glance:
        """Writes registers in several steps, between which no other thread writes; wakes the run.

        Args:
            steps: for each step, the values by register name (see `Station.put`).

        Returns:
            The station's state after the last step.
        """
        with self._lock:
            for changes in steps:
                self._station.put(changes, self.clock.now())
                self._look()
            seen = self._seen
        self._wake()
        return seen

    def confirm(self) -> None:
        """Clears the error that the station shows, see `Station.confirm`."""
        with self._step() as station:
            station.confirm()

    def disconnect(self) -> None:
        """Notes that the only client that may write has left: disables triggers (`Station.disconnect`)."""
        with self._step() as station:
            station.disconnect()
        self.connected = False
        self._wake()

    # -- the run's side -------------------------------------------------------------------------------

    @property
    def glance(self) -> Glance:
        """A snapshot of the station's state (`Station.glance`), after a look at the PLC's heartbeat.

        The run has to notice that the heartbeat has stopped even if no client reads or writes any more.
        """
        with self._step() as station:
            station.tick(self.clock.now())
            return station.glance

    def wait(self, seconds: float) -> None:
        """Waits until the PLC writes something or disconnects, for `seconds` at most."""
        with suppress(queue.Empty):
            self._news.get(timeout=max(seconds, 0.0))

    def finish(self, answer: Answer) -> None:
        """Ends the part under way, if any, and shows its answer, see `Station.finish`."""
        with self._step() as station:
            if station.order is not None:
                station.finish(answer)

    def end(self) -> None:
        """Refuses all later triggers, see `Station.end`."""
        with self._step() as station:
            station.end()

    @contextmanager
    def _step(self) -> Iterator[Station]:
        """Context that locks the station and yields it, and calls `watch` if the state changes meanwhile."""
        with self._lock:
            yield self._station
            self._look()

    def _look(self) -> None:
        if (glance := self._station.glance) != self._seen:
            self._seen = glance
            self.watch(glance)

    def _wake(self) -> None:
        if self._news.empty():
            self._news.put(None)


def answer_of(table: Table, result: PartResult) -> Answer:
    """Converts the result of a part to the values of the PLC's registers."""
    outcome = OUTCOMES.index(_NAMES.get(result.outcome, "fault"))
    seconds = nan if result.seconds is None else result.seconds
    leaf = result.leaf_of(table)
    if result.outcome is not Outcome.LEAF or leaf is None:
        return Answer(outcome, int(result.exit_code), seconds=seconds)
    pose = leaf.x_um, leaf.y_um, round(1e4 * degrees(leaf.theta_urad / 1e6))
    kind = _part_and_face(table, leaf)
    errors = _error(leaf, leaf.error_median_um), _error(leaf, leaf.error_p95_um)
    return Answer(outcome, int(result.exit_code), *pose, *kind, *errors, seconds)


def _error(leaf: Leaf, error_um: int) -> int:
    return min(error_um, UNKNOWN) if leaf.trials else UNKNOWN


def parts_of(table: Table) -> list[str]:
    """Names of the parts that a table distinguishes, in the job's order; empty for a single part."""
    names = (hypothesis.name.removesuffix(TURNED_OVER) for hypothesis in table.hypotheses)
    return list(dict.fromkeys(names))


def _part_and_face(table: Table, leaf: Leaf) -> tuple[int, int]:
    """Returns which part a leaf names, as an index in `parts_of`, and its face: 0 as drawn, 1 turned over."""
    if not table.hypotheses:
        return 0, 0
    name = table.hypotheses[leaf.hypothesis].name
    part = parts_of(table).index(name.removesuffix(TURNED_OVER))
    return part, int(name.endswith(TURNED_OVER))
