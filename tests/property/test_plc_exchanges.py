"""The handshake with a PLC keeps its promises, whatever the PLC does and whenever."""

from random import Random

import pytest
from plc_programs import MemoryPlc
from plc_study import Faults, Study

from runtime.plc import station
from runtime.plc.handshake import SIGNALS, TABLE, Event, State, Transition
from runtime.plc.registers import HEARTBEAT_LIMIT_S

SHOWN = ("result_id", "outcome", "x", "y", "angle", "expected_error", "exit_code")


@pytest.mark.parametrize("seed", [1, 2])
def test_station_faulty_exchanges_lose_and_repeat_no_result(seed: int) -> None:
    study = Study(seed)
    study.run(500)
    study.check()
    mishaps = ("dropped", "doubled", "late", "discarded", "broken", "lazy")
    assert all(study.counts[name] for name in mishaps)


def check_each_step(study: Study) -> None:
    for _ in range(20_000):
        study.step()
        study.check()


def test_station_without_faults_reports_no_error() -> None:
    study = Study(0, Faults(*[0.0] * 8))
    study.run(200)
    study.check()
    assert not [name for name in study.counts if name.startswith("error") and study.counts[name]]


@pytest.mark.parametrize(
    ("state", "event"),
    [(State.WAITING, Event.ACKNOWLEDGE_BACK), (State.PRESENTED, Event.TRIGGER_BACK)],
    ids=lambda each: each.name,
)
def test_study_handshake_that_loses_results_is_detected(state, event, monkeypatch):
    wrong = {**TABLE, (state, event): Transition(State.READY)}
    monkeypatch.setattr(station, "TABLE", wrong)
    study = Study(1)
    with pytest.raises(AssertionError):
        check_each_step(study)


@pytest.mark.parametrize("seed", range(2))
def test_station_random_writes_keep_each_promise(seed: int) -> None:
    """A PLC writes random registers, parts end, the connection breaks, time passes: each step is checked.

    What must follow is derived from the levels of the signals alone.
    """
    random, plc = Random(seed), MemoryPlc()
    names = ("enable", "trigger", "result_acknowledge", "heartbeat_in", "trigger_id", "table")
    level = dict.fromkeys(names, 0)
    for _ in range(3000):
        before, order = SIGNALS[plc.station.state], plc.station.order
        shown, enabled = plc(*SHOWN), plc["enable"] == 1
        rises: set[str] = set()
        choice = random.random()
        if choice < 0.9:
            name = random.choice(names)
            value = random.randrange(2) if name != "trigger_id" else random.randrange(0x10000)
            rises = {name} if value and not level[name] else set()
            level[name] = value
            plc.write(**{name: value})
        elif choice < 0.96 and order is not None:
            plc.end_part(x=random.randrange(-100, 100))
            assert (plc["result_id"], plc["result_valid"]) == (order.trigger_id, 1)
            continue
        elif choice < 0.98:
            plc.station.disconnect()
        else:
            plc.now += random.choice((0.5, HEARTBEAT_LIMIT_S + 1))
        after = SIGNALS[plc.station.state]
        if plc.station.order is not order:
            assert order is None
            assert rises == {"trigger"}
            assert enabled
            assert not before.busy
            assert not before.result_valid
            assert plc.station.order == (level["trigger_id"], level["table"])
        if before.result_valid and not after.result_valid:
            assert rises == {"result_acknowledge"}
        if before.result_valid and after.result_valid:
            assert plc(*SHOWN) == shown
        if before.busy:
            assert after.busy
        if plc.station.state is State.READY:
            assert plc(*SHOWN) == [0] * len(SHOWN)
