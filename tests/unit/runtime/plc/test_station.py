"""A station in memory: the levels that a PLC writes drive the handshake, whatever their order and time."""

import pytest
from plc_programs import MemoryPlc

from runtime.plc.handshake import Error
from runtime.plc.registers import HEARTBEAT_LIMIT_S, READ
from runtime.plc.station import Counters, Order

SIGNALS = ("acknowledge", "busy", "result_valid", "result_id")
RESULT = {"x": -1200, "y": 70_000, "angle": -1_799_999, "part": 2, "face": 1, "expected_error": 300}


@pytest.fixture
def plc():
    return MemoryPlc()


@pytest.fixture
def enabled(plc):
    plc.write(enable=1)
    return plc


@pytest.fixture
def working(enabled):
    enabled.write(trigger_id=7)
    enabled.pulse("trigger")
    return enabled


@pytest.fixture
def waiting(working):
    working.end_part(**RESULT)
    return working


def test_station_part_follows_documented_handshake(enabled):
    enabled.write(trigger_id=7)
    assert enabled(*SIGNALS) == [0, 0, 0, 0]
    enabled.write(trigger=1)
    assert enabled(*SIGNALS) == [1, 1, 0, 0]
    assert enabled.station.order == Order(7, 0)
    enabled.write(trigger=0, trigger_id=99)
    assert enabled(*SIGNALS) == [0, 1, 0, 0]
    enabled.end_part(**RESULT)
    assert enabled(*SIGNALS) == [0, 0, 1, 7]
    assert enabled(*RESULT) == list(RESULT.values())
    enabled.write(result_acknowledge=1)
    assert enabled(*SIGNALS) == [0, 0, 0, 7]
    enabled.write(result_acknowledge=0)
    counters = set(Counters().values())
    quiet = {"heartbeat_out", "table_digest", *counters}
    assert [enabled[register.name] for register in READ if register.name not in quiet] == [0] * 15


def test_station_trigger_without_enable_is_error_and_starts_nothing(plc):
    plc.write(trigger=1)
    assert (plc["error_id"], plc.station.order) == (Error.NOT_ENABLED, None)
    plc.write(enable=1)  # the trigger is high already and does not rise
    assert (plc["error_id"], plc.station.order) == (0, None)
    plc.write(trigger=0, enable=0)
    plc.write(trigger=1)
    assert plc.station.order is None


@pytest.mark.parametrize("fixture", ["working", "waiting"])
def test_station_second_trigger_is_error_and_changes_nothing(fixture, request):
    plc = request.getfixturevalue(fixture)
    before, shown, order = plc(*SIGNALS), plc(*RESULT), plc.station.order
    plc.write(trigger_id=8, trigger=1)
    assert plc["error_id"] == (Error.PART_UNDER_WAY if order else Error.RESULT_WAITS)
    assert (plc(*SIGNALS), plc(*RESULT), plc.station.order) == (before, shown, order)
    plc.write(enable=0)
    assert plc["error_id"] != 0
    plc.write(enable=1)
    assert plc["error_id"] == 0
    assert (plc(*SIGNALS), plc(*RESULT), plc.station.order) == (before, shown, order)


def test_station_early_acknowledge_keeps_result(working):
    working.write(result_acknowledge=1)
    working.end_part()
    assert working["result_valid"] == 1
    working.write(result_acknowledge=1)
    assert working["result_valid"] == 1
    working.write(result_acknowledge=0)
    assert working["result_valid"] == 1
    working.write(result_acknowledge=1)
    assert working["result_valid"] == 0


@pytest.mark.parametrize("end", ["enable", "heartbeat", "connection"])
@pytest.mark.parametrize("fixture", ["enabled", "working", "waiting"])
def test_station_disabled_keeps_part_and_result_and_refuses_triggers(fixture, end, request):
    plc = request.getfixturevalue(fixture)
    before, order = plc(*SIGNALS), plc.station.order
    if end == "enable":
        plc.write(enable=0)
    elif end == "heartbeat":
        plc.now += HEARTBEAT_LIMIT_S + 0.1
    else:
        plc.station.disconnect()
    assert plc["enable"] == 0
    ends = {"enable": 0, "heartbeat": Error.HEARTBEAT, "connection": Error.CONNECTION_LOST}
    assert plc["error_id"] == ends[end]
    assert (plc(*SIGNALS), plc.station.order) == (before, order)
    plc.write(trigger_id=9, trigger=1)
    assert (plc["error_id"], plc.station.order) == (Error.NOT_ENABLED, order)
    if order is not None:
        plc.end_part()
    assert plc["result_id"] == (7 if fixture != "enabled" else 0)


@pytest.mark.parametrize("period_s", [1.0, HEARTBEAT_LIMIT_S])
def test_station_regular_heartbeat_stays_enabled(enabled, period_s):
    for beat in range(20):
        enabled.now += period_s
        enabled.write(heartbeat_in=1 - beat % 2)
        assert enabled["enable"] == 1


def test_station_stopped_heartbeat_must_change_before_enabling(enabled):
    enabled.now += HEARTBEAT_LIMIT_S + 0.1
    for _ in range(3):
        enabled.write(heartbeat_in=0, enable=1)
        assert enabled("enable", "error_id") == [0, Error.HEARTBEAT]
    enabled.write(heartbeat_in=1, enable=1)
    assert enabled("enable", "error_id") == [1, 0]


def test_station_lost_connection_creates_no_edge(working):
    working.write(result_acknowledge=1)
    working.station.disconnect()
    working.end_part()
    working.write(result_acknowledge=1)  # as a PLC that writes its outputs anew
    assert working("result_valid", "result_id") == [1, 7]


def test_station_unknown_table_is_error_and_others_are_used():
    plc = MemoryPlc((0x11111111, 0xA2222222))
    plc.write(enable=1, table=2, trigger=1)
    assert (plc["error_id"], plc.station.order) == (Error.UNKNOWN_TABLE, None)
    assert plc("table_in_use", "table_digest") == [0, 0x11111111]
    plc.write(trigger=0, table=1, trigger_id=5)
    plc.write(trigger=1)
    assert plc.station.order == Order(5, 1)
    plc.write(table=0)
    assert plc("table_in_use", "table_digest") == [1, 0xA2222222]
