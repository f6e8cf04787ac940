"""The station of a PLC: holds the registers, and turns writes to them into events of the handshake.

The module has no sockets, threads or clocks; callers pass the time.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from math import nan
from typing import NamedTuple

from runtime.plc.handshake import SIGNALS, TABLE, Error, Event, State
from runtime.plc.registers import HEARTBEAT_LIMIT_S, OUTCOMES, READ, UNKNOWN, WRITTEN, words
from runtime.table import takt_figures

BEAT_S = 0.25  # time between two changes of `heartbeat_out`


class Refusal(IntEnum):
    """Why a read or a write of registers is refused, as a Modbus exception code."""

    ADDRESS = 2
    VALUE = 3


class Order(NamedTuple):
    """A PLC's request to locate one part."""

    trigger_id: int  # number that the PLC gave to the trigger
    table: int  # number of the table to use


class Answer(NamedTuple):
    """Result of a part, in the units of the registers; the pose is 0 if the part was not located."""

    outcome: int = 0  # index in `OUTCOMES`
    exit_code: int = 0
    x: int = 0
    y: int = 0
    angle: int = 0
    part: int = 0
    face: int = 0
    expected_error: int = 0
    expected_error_p95: int = 0
    # from the part's first motion to its outcome, delivery included; NaN where this was not measured
    seconds: float = nan


EMPTY = Answer()
FAULT = 4  # value of `Answer.outcome`
_ADDRESSES = {register.address: register for register in WRITTEN}


class Glance(NamedTuple):
    """Snapshot of a station's state, for observers."""

    state: State
    order: Order | None  # the part under way; None if there is none
    answer: Answer  # the latest result; `EMPTY` from the end of the handshake until the next result
    enabled: bool  # whether triggers are enabled
    withdrawn: bool  # whether enabling has ended since the last accepted trigger
    ended: bool  # whether the run has ended, so that triggers are refused
    error_id: int
    table: int | None  # number of the table for the next trigger; None if there is no such table
    in_use: int  # number of the table that the last accepted trigger requested


class Counters:
    """Statistics for the PLC: parts by outcome, seconds of the last part, share of parts within the takt.

    Args:
        takt_s: time within which parts should be done; None: no takt.
    """

    def __init__(self, takt_s: float | None = None) -> None:
        self._takt_s = takt_s
        self._seconds: Counter[float] = Counter()  # rounded to 0.01 s, which limits their number
        self._values = {f"parts_{name}": 0 for name in OUTCOMES[1:]}
        self._values |= {"seconds_last": UNKNOWN, "takt_share": UNKNOWN}

    def add(self, outcome: int, seconds: float) -> None:
        """Counts one part.

        Args:
            outcome: the part's `Answer.outcome`.
            seconds: time that the part took, s; NaN if unknown.
        """
        self._values[f"parts_{OUTCOMES[outcome]}"] += 1
        self._values["seconds_last"] = UNKNOWN
        if not seconds > 0.0:  # NaN, or 0 from a clock that does not advance
            return
        self._values["seconds_last"] = min(round(100.0 * seconds), UNKNOWN)
        self._seconds[round(seconds, 2)] += 1
        if self._takt_s is not None:
            share = takt_figures(self._seconds, self._takt_s)["takt_probability"]
            self._values["takt_share"] = round(1e4 * share)

    def values(self) -> dict[str, int]:
        """Returns the statistics as register values, by register name."""
        return self._values


class Station:
    """The registers of one PLC, and the state of its handshake.

    Args:
        digests: for each table, the first four bytes of its SHA-256 as an integer.
        takt_s: time within which parts should be done, s; None: no takt.
        beats: whether the PLC has to change `heartbeat_in` regularly.

    Attributes:
        state: state of the handshake.
        order: the part under way; None if there is none.
        enabled: whether triggers are enabled.
        error_id: an `Error`, or the exit code of a fault.
    """

    def __init__(
        self, digests: Sequence[int], takt_s: float | None = None, *, beats: bool = True
    ) -> None:
        self.state = State.READY
        self.order: Order | None = None
        self.enabled = False
        self.error_id = 0
        self._digests, self._beats = digests, beats
        self._written = dict.fromkeys((register.name for register in WRITTEN), 0)
        self._in_use = 0  # number of a table
        self._result_id, self._answer = 0, EMPTY
        self._counters = Counters(takt_s)
        self._beat_s = 0.0  # when `heartbeat_in` last changed, or triggers were enabled
        # whether triggers were disabled for a stopped `heartbeat_in`, which has not changed since
        self._standing = False
        self._withdrawn = self._ended = False

    def write(self, address: int, values: Sequence[int], now: float) -> Refusal | None:
        """Writes consecutive registers; if one value is refused, writes none.

        Args:
            address: address of the first register.
            values: one word for each register.
            now: the time, in seconds of a clock that never goes back.

        Returns:
            Why nothing was written; None if the registers were written.
        """
        changes: dict[str, int] = {}
        for place, value in enumerate(values, address):
            register = _ADDRESSES.get(place)
            if register is None:
                return Refusal.ADDRESS
            if not 0 <= value <= register.greatest:
                return Refusal.VALUE
            changes[register.name] = value
        self.put(changes, now)
        return None

    def put(self, changes: Mapping[str, int], now: float) -> None:
        """Writes registers, and gives the handshake the events that follow from the changes.

        Args:
            changes: valid values by register name.
            now: the time, as in `write`.
        """
        self.tick(now)
        before, self._written = self._written, {**self._written, **changes}
        if self._written["heartbeat_in"] != before["heartbeat_in"]:
            self._beat_s, self._standing = now, False
        if "enable" in changes:
            self._enable(wanted=changes["enable"] == 1, now=now)
        self._edge(before, "result_acknowledge", lambda: Event.ACKNOWLEDGE, Event.ACKNOWLEDGE_BACK)
        self._edge(before, "trigger", self._trigger, Event.TRIGGER_BACK)

    def read(self, address: int, count: int, now: float) -> list[int] | Refusal:
        """Reads words of one of the two blocks of registers.

        Args:
            address: address of the first word.
            count: number of words.
            now: the time, as in `write`.

        Returns:
            The words; a refusal if they do not all lie in one block.
        """
        self.tick(now)
        block, values = WRITTEN, self._written
        if address >= READ[0].address:
            block, values = READ, self._shown(now)
        content = words(block, values)[address - block[0].address :][:count]
        return content if content and len(content) == count else Refusal.ADDRESS

    def tick(self, now: float) -> None:
        """Disables triggers if the PLC's heartbeat has stopped for longer than `HEARTBEAT_LIMIT_S`."""
        if self.enabled and self._beats and now - self._beat_s > HEARTBEAT_LIMIT_S:
            self._standing = True
            self._disable(Error.HEARTBEAT)

    def disconnect(self) -> None:
        """Disables triggers after the connection to the PLC is lost.

        The registers `trigger` and `result_acknowledge` stay as they are, so that a PLC that connects again
        and writes the same values causes no event.
        """
        if self.enabled:
            self._disable(Error.CONNECTION_LOST)

    def finish(self, answer: Answer) -> None:
        """Ends the part under way, and shows its answer until the PLC acknowledges it.

        There must be a part under way.
        """
        assert self.order is not None
        self._result_id, self._answer, self.order = self.order.trigger_id, answer, None
        self._counters.add(answer.outcome, answer.seconds)
        self._follow(Event.RESULT)
        if answer.outcome == FAULT:
            self.error_id = answer.exit_code

    def confirm(self) -> None:
        """Clears the error in `error_id`."""
        self.error_id = Error.NONE

    @property
    def glance(self) -> Glance:
        """A snapshot of the present state, for observers."""
        part, tables = (self.order, self._answer), (self._table, self._in_use)
        flags = self.enabled, self._withdrawn, self._ended
        return Glance(self.state, *part, *flags, self.error_id, *tables)

    def end(self) -> None:
        """Notes that the run has ended: from now on all triggers are refused."""
        self._ended = True

    @property
    def _table(self) -> int | None:
        table = self._written["table"]
        return table if table < len(self._digests) else None

    def _enable(self, *, wanted: bool, now: float) -> None:
        if not wanted:
            self.enabled, self._withdrawn = False, True
        elif self._standing and not self.enabled:
            self._disable(Error.HEARTBEAT)
        elif not self.enabled:
            self.enabled, self.error_id, self._beat_s = True, Error.NONE, now

    def _disable(self, error: Error) -> None:
        self.enabled, self._withdrawn, self.error_id = False, True, error
        self._written["enable"] = 0

    def _edge(
        self, before: Mapping[str, int], name: str, rise: Callable[[], Event], fall: Event
    ) -> None:
        if self._written[name] != before[name]:
            self._follow(rise() if self._written[name] else fall)

    def _trigger(self) -> Event:
        if self._ended:
            return Event.TRIGGER_AFTER_END
        if not self.enabled:
            return Event.TRIGGER_DISABLED
        if self._table is None:
            return Event.TRIGGER_UNKNOWN_TABLE
        return Event.TRIGGER

    def _follow(self, event: Event) -> None:
        before, (self.state, error) = self.state, TABLE[self.state, event]
        if error:
            self.error_id = error
        if self.state is before:
            return
        if event is Event.TRIGGER:
            self.order = Order(self._written["trigger_id"], self._written["table"])
            self._in_use, self._withdrawn = self.order.table, False
        if self.state in (State.READY, State.ACCEPTED):
            self._result_id, self._answer = 0, EMPTY

    def _shown(self, now: float) -> dict[str, int]:
        """Values of the registers that the runtime writes, by name; `now` is for the heartbeat."""
        return {
            **SIGNALS[self.state]._asdict(),
            **self._answer._asdict(),
            **self._counters.values(),
            "result_id": self._result_id,
            "error_id": self.error_id,
            "heartbeat_out": int(now / BEAT_S) & 0xFFFF,
            "table_in_use": self._in_use,
            "table_digest": self._digests[self._in_use],
        }
