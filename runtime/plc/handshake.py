"""The handshake with a PLC for each part, as a state machine: trigger, result, acknowledgement.

`TABLE` maps each state and event to the next state; `tools/docs/plc.md` shows the same table. The module does
not use registers, sockets or clocks.
"""

from collections.abc import Mapping
from enum import Enum, IntEnum
from typing import NamedTuple


class State(Enum):
    """State of the handshake; the value is the state's name in the documentation."""

    READY = "ready"  # waits for a trigger
    ACCEPTED = "accepted"  # a part is under way, `trigger` is still up
    WORKING = "working"  # a part is under way, `trigger` is down
    PRESENTED = "presented"  # a result waits, `trigger` is still up
    WAITING = "waiting"  # a result waits, `trigger` is down
    TAKEN = "taken"  # the result is taken; `trigger` and `result_acknowledge` still up
    TRIGGER_HELD = "trigger held"  # the result is taken; `trigger` still up
    ACKNOWLEDGE_HELD = "acknowledge held"  # the result is taken; `result_acknowledge` still up


class Event(Enum):
    """Event of the handshake; the value is the event's name in the documentation."""

    TRIGGER = "trigger rises"
    TRIGGER_DISABLED = "trigger rises, not enabled"
    TRIGGER_UNKNOWN_TABLE = "trigger rises, no such table"
    TRIGGER_AFTER_END = "trigger rises, run ended"
    TRIGGER_BACK = "trigger falls"
    RESULT = "the part ends"
    ACKNOWLEDGE = "result_acknowledge rises"
    ACKNOWLEDGE_BACK = "result_acknowledge falls"


class Error(IntEnum):
    """Errors of the handshake, as values of the register `error_id`; the register also holds exit codes."""

    NONE = 0
    NOT_ENABLED = 101
    PART_UNDER_WAY = 102
    RESULT_WAITS = 103
    UNKNOWN_TABLE = 104
    HEARTBEAT = 105
    CONNECTION_LOST = 106
    RUN_ENDED = 107


class Signals(NamedTuple):
    """Levels of the handshake's three signals to the PLC, in a state."""

    acknowledge: bool
    busy: bool
    result_valid: bool


class Transition(NamedTuple):
    """Result of an event: the next state, and an error. If there is an error, the state does not change."""

    following: State
    error: Error = Error.NONE


SIGNALS: Mapping[State, Signals] = {
    State.READY: Signals(acknowledge=False, busy=False, result_valid=False),
    State.ACCEPTED: Signals(acknowledge=True, busy=True, result_valid=False),
    State.WORKING: Signals(acknowledge=False, busy=True, result_valid=False),
    State.PRESENTED: Signals(acknowledge=True, busy=False, result_valid=True),
    State.WAITING: Signals(acknowledge=False, busy=False, result_valid=True),
    State.TAKEN: Signals(acknowledge=True, busy=False, result_valid=False),
    State.TRIGGER_HELD: Signals(acknowledge=True, busy=False, result_valid=False),
    State.ACKNOWLEDGE_HELD: Signals(acknowledge=False, busy=False, result_valid=False),
}

# The states in which a part is under way or its result waits.
OPEN = frozenset(state for state in State if SIGNALS[state].busy or SIGNALS[state].result_valid)

_CHANGES = {
    (State.READY, Event.TRIGGER): State.ACCEPTED,
    (State.ACCEPTED, Event.TRIGGER_BACK): State.WORKING,
    (State.ACCEPTED, Event.RESULT): State.PRESENTED,
    (State.WORKING, Event.RESULT): State.WAITING,
    (State.PRESENTED, Event.TRIGGER_BACK): State.WAITING,
    (State.PRESENTED, Event.ACKNOWLEDGE): State.TAKEN,
    (State.WAITING, Event.ACKNOWLEDGE): State.ACKNOWLEDGE_HELD,
    (State.TAKEN, Event.TRIGGER_BACK): State.ACKNOWLEDGE_HELD,
    (State.TAKEN, Event.ACKNOWLEDGE_BACK): State.TRIGGER_HELD,
    (State.TRIGGER_HELD, Event.TRIGGER_BACK): State.READY,
    (State.TRIGGER_HELD, Event.ACKNOWLEDGE): State.TAKEN,
    (State.ACKNOWLEDGE_HELD, Event.ACKNOWLEDGE_BACK): State.READY,
    # A PLC may start the next part with `result_acknowledge` still up. It takes the next result only when
    # it lowers the signal and raises it again.
    (State.ACKNOWLEDGE_HELD, Event.TRIGGER): State.ACCEPTED,
}

_REFUSALS = {
    Event.TRIGGER_DISABLED: Error.NOT_ENABLED,
    Event.TRIGGER_UNKNOWN_TABLE: Error.UNKNOWN_TABLE,
    Event.TRIGGER_AFTER_END: Error.RUN_ENDED,
}


def _transition(state: State, event: Event) -> Transition:
    if (state, event) in _CHANGES:
        return Transition(_CHANGES[state, event])
    if event is Event.TRIGGER:
        busy = SIGNALS[state].busy
        return Transition(state, Error.PART_UNDER_WAY if busy else Error.RESULT_WAITS)
    return Transition(state, _REFUSALS.get(event, Error.NONE))


# The state machine: an entry for each state and each event.
TABLE: Mapping[tuple[State, Event], Transition] = {
    (state, event): _transition(state, event) for state in State for event in Event
}
