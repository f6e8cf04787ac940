"""The table of the handshake: in every state, each event leads where the rules of the handshake say."""

import pytest

from runtime.plc.handshake import SIGNALS, TABLE, Error, Event, State, Transition

REFUSED = {
    Event.TRIGGER_DISABLED: Error.NOT_ENABLED,
    Event.TRIGGER_UNKNOWN_TABLE: Error.UNKNOWN_TABLE,
    Event.TRIGGER_AFTER_END: Error.RUN_ENDED,
}
BUSY = {state for state in State if SIGNALS[state].busy}
VALID = {state for state in State if SIGNALS[state].result_valid}
ALL = [(state, event) for state in State for event in Event]


def test_table_holds_every_state_with_every_event():
    assert list(TABLE) == ALL
    assert len(TABLE) == 8 * 8


@pytest.mark.parametrize(("state", "event"), ALL, ids=lambda each: each.name)
def test_transition_follows_the_rules_of_the_handshake(state, event):
    after, error = TABLE[state, event]
    before, shown = SIGNALS[state], SIGNALS[after]
    # Only an accepted trigger begins a part; an error changes nothing.
    if shown.busy and not before.busy:
        assert event is Event.TRIGGER
        assert not before.result_valid
    if error:
        assert after is state
    if event in REFUSED:
        assert error is REFUSED[event]
    # Only a result ends the part under way.
    if state in BUSY:
        assert (after in BUSY) == (event is not Event.RESULT)
        assert (after in VALID) == (event is Event.RESULT)
    # A result appears at the end of a part and disappears at a rising acknowledge.
    if state in VALID:
        assert (after in VALID) == (event is not Event.ACKNOWLEDGE)
    if after in VALID and state not in VALID:
        assert event is Event.RESULT
    # A second trigger is an error exactly where a part is under way or a result waits.
    if event is Event.TRIGGER:
        expected = Error.NONE
        if state in BUSY:
            expected = Error.PART_UNDER_WAY
        elif state in VALID or before.acknowledge:
            expected = Error.RESULT_WAITS
        assert error is expected
        assert error or after is State.ACCEPTED
    # `acknowledge` rises and falls with the accepted trigger.
    if shown.acknowledge != before.acknowledge:
        assert event is (Event.TRIGGER if shown.acknowledge else Event.TRIGGER_BACK)
    if before.acknowledge and event is Event.TRIGGER_BACK:
        assert not shown.acknowledge


@pytest.mark.parametrize("state", State)
def test_table_state_is_reachable_from_ready_and_leads_back(state):
    def reached(start):
        known = {start}
        while more := {TABLE[each, event].following for each in known for event in Event} - known:
            known |= more
        return known

    assert state in reached(State.READY)
    assert State.READY in reached(state)


def test_table_ready_requires_trigger_and_acknowledge_low():
    back = {State.TRIGGER_HELD: Event.TRIGGER_BACK, State.ACKNOWLEDGE_HELD: Event.ACKNOWLEDGE_BACK}
    into = {key for key, after in TABLE.items() if after == Transition(State.READY)}
    assert {key for key in into if key[0] is not State.READY} == {*back.items()}
