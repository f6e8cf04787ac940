"""Counters of a station: parts by outcome, seconds of the last part, share of parts within the takt."""

from math import nan

import pytest
from plc_programs import MemoryPlc

from runtime.plc.handshake import State
from runtime.plc.registers import OUTCOMES, UNKNOWN
from runtime.plc.station import Answer, Station

PARTS = tuple(f"parts_{name}" for name in OUTCOMES[1:])


def run(plc: MemoryPlc, outcome: int, seconds: float | None = None) -> None:
    """Runs a part that ends with an outcome after some seconds, and acknowledges the result."""
    plc.write(enable=0)
    plc.write(enable=1)
    plc.pulse("trigger")
    plc.station.finish(Answer(outcome, seconds=nan if seconds is None else seconds))
    plc.pulse("result_acknowledge")
    assert plc.station.state is State.READY


@pytest.fixture
def plc():
    memory = MemoryPlc()
    memory.station = Station([0], takt_s=6.0)
    return memory


def test_counters_count_outcomes_and_outlast_results(plc):
    for outcome in (1, 1, 2, 3, 1, 4):
        run(plc, outcome)
    assert plc(*PARTS) == [3, 1, 1, 1]
    assert plc("result_valid", "outcome") == [0, 0]


def test_takt_share_counts_only_parts_with_seconds(plc):
    for seconds in (5.25, 6.0, None, 6.01, 7.5):
        run(plc, 1, seconds)
    assert plc("parts_located", "seconds_last", "takt_share") == [5, 750, 5000]
    run(plc, 4)
    assert plc("seconds_last", "takt_share") == [UNKNOWN, 5000]
