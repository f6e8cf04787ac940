"""The driver of a SCHUNK gripper against its simulator in virtual time: moves, faults, a bad line."""

import math

import pytest
from schunk_rigs import VirtualSchunk

from drivers.errors import GripperFault, LinkTimeout, PortError
from drivers.ports import ObjectState
from drivers.schunk.gripper import gripper as open_port
from drivers.schunk.link import ALIVE_S
from drivers.schunk.registers import ERRORS, PARAMETERS, Control
from drivers.sim.devices.schunk import SILENCE_S
from drivers.sim.wire.line import Piece
from runtime.table import PROFILES

EGU, EGK = PROFILES["schunk-egu"], PROFILES["schunk-egk"]
FAST, WEAK = EGU.speed_mm_s[1], EGU.force_n[0]


@pytest.fixture
def rig():
    return VirtualSchunk()


@pytest.fixture
def active(rig):
    gripper = rig.connect()
    gripper.activate()
    return gripper


def hold(rig, gripper):
    """Put a part between the fingers and close them on it."""
    rig.part.width_mm = 41.0
    gripper.move(0, FAST, WEAK)
    gripper.wait()


def lost(request, reply):
    return []


def half(request, reply):
    return [Piece(reply[: len(reply) // 2])]


def flipped(request, reply):
    return [Piece(bytes((*reply[:-3], reply[-3] ^ 1, *reply[-2:])))]


def echoed(request, reply):
    return [Piece(request), Piece(reply)]


def late(request, reply):
    return [Piece(reply, 0.7)]


# -- readiness ------------------------------------------------------------------------------------


def test_activate_acknowledges_without_moving(rig, active):
    state = active.state()
    assert (state.activated, state.fault, state.fault_text) == (True, 0, "")
    assert (state.object, state.width_um) == (ObjectState.NONE, EGU.stroke_um)
    written = list(rig.model.written)
    active.activate()
    assert rig.model.written == written


@pytest.mark.parametrize("code", ERRORS)
def test_gripper_error_is_reported_with_sentence_until_activated(rig, active, code):
    rig.model.fail(code, rig.clock.now())
    state = active.state()
    assert (state.fault, state.activated) == (code, False)
    assert state.fault_text == f"0x{code:02X}, {ERRORS[code]}"
    with pytest.raises(GripperFault, match=f"0x{code:02X}"):
        active.move(0, FAST, WEAK)
    active.activate()
    assert active.state().activated


def test_wait_power_cycle_during_move_raises_fault(rig, active):
    active.move(60_000, FAST, WEAK)
    rig.model.power_cycle(rig.clock.now())
    with pytest.raises(GripperFault, match="not acknowledged since power-on"):
        active.wait()


# -- moves ----------------------------------------------------------------------------------------


def test_move_to_width_arrives_in_expected_time(active):
    active.move(60_000, 100.0, WEAK)
    assert active.state().moving
    settled = active.wait()
    assert (settled.width_um, settled.object) == (60_000, ObjectState.AT_TARGET)
    assert settled.target_um == active.state().target_um == 60_000
    assert 0.6 <= settled.seconds < 0.7


def test_move_speed_out_of_range_is_limited(rig, active):
    active.move(50_000, 1.0, WEAK)
    assert active.wait().seconds == pytest.approx(7.0, abs=0.2)  # 70 mm at the least 10 mm/s
    active.move(EGU.stroke_um, 900.0, WEAK)
    assert active.wait().width_um == EGU.stroke_um


def test_move_onto_part_grips_it_and_next_move_releases_it(rig, active):
    rig.part.width_mm = 41.237
    active.move(0, FAST, WEAK)
    settled = active.wait()
    assert (settled.width_um, settled.object) == (41_240, ObjectState.CLOSING)
    assert (rig.part.grips, rig.part.releases) == (1, 0)
    active.move(100_000, FAST, WEAK)
    settled = active.wait()
    assert (settled.width_um, settled.object) == (100_000, ObjectState.AT_TARGET)
    assert rig.part.releases == 1


def test_move_with_more_force_releases_and_grips_again(rig, active):
    hold(rig, active)
    active.move(0, FAST, 2 * WEAK)
    settled = active.wait()
    assert (settled.width_um, settled.object) == (41_000, ObjectState.CLOSING)
    assert (rig.part.grips, rig.part.releases) == (2, 1)


@pytest.mark.parametrize("width_um", [0, 20_000, EGU.stroke_um])
@pytest.mark.parametrize("spike_mm", [0.0, 120.0])
def test_move_after_wrong_width_reading_ends_at_target(rig, active, width_um, spike_mm):
    active.move(60_000, FAST, WEAK)
    active.wait()
    right = rig.model._values

    def wrong(name):
        values = right(name)
        if name != "plc_sync_input":
            return values
        rig.model._values = right
        return (values[0], int(1000 * spike_mm), *values[2:])

    rig.model._values = wrong
    active.move(width_um, EGU.speed_mm_s[0], WEAK)
    assert active.wait().width_um == width_um


def test_wait_part_blocking_positioning_move_raises_fault(rig, active):
    rig.part.width_mm = 41.0
    active.move(30_000, FAST, WEAK)
    with pytest.raises(GripperFault, match=r"0xF4.*blocks the fingers"):
        active.wait()


@pytest.mark.parametrize(("force_n", "percent"), [(1.0, 50), (325.0, 50), (400.0, 61), (9e2, 100)])
def test_move_force_is_sent_as_percentage_rounded_down(rig, active, force_n, percent):
    active.move(0, FAST, force_n)
    assert rig.model.read("plc_sync_output", rig.clock.now())[12:] == percent.to_bytes(4, "little")
    active.wait()


def test_move_grip_speed_follows_request_on_egk_and_force_on_egu():
    seconds = {}
    for model in ("schunk-egu", "schunk-egk"):
        rig = VirtualSchunk(model)
        gripper = rig.connect()
        gripper.activate()
        gripper.move(40_000, 60.0, 1.0)
        gripper.wait()
        gripper.move(0, 5.0, 1.0)
        seconds[model] = gripper.wait().seconds
    assert seconds["schunk-egk"] == pytest.approx(8.0, abs=0.1)  # 40 mm at 5 mm/s
    assert seconds["schunk-egu"] == pytest.approx(3.2, abs=0.1)  # 40 mm at half of 25 mm/s


def test_stop_while_holding_keeps_part(rig, active):
    hold(rig, active)
    active.stop()
    state = active.state()
    assert (state.object, state.width_um) == (ObjectState.CLOSING, 41_000)
    assert rig.part.releases == 0


def test_wait_command_of_another_program_raises_fault(rig, active):
    active.move(60_000, FAST, WEAK)
    rig.clock.sleep(0.1)
    output = PARAMETERS["plc_sync_output"]
    control = Control.NO_FAST_STOP | Control.MOVE_ABSOLUTE
    rig.model.write("plc_sync_output", output.pack(control, 60_000, 50_000, 0), rig.clock.now())
    with pytest.raises(GripperFault, match=r"another program|taking the request"):
        active.wait()


def test_wait_infeasible_command_raises_fault_with_reason(rig, active):
    rig.model.write("max_pos", PARAMETERS["max_pos"].pack(50.0), rig.clock.now())
    active.move(60_000, FAST, WEAK)
    with pytest.raises(GripperFault, match=r"refused.*outside min_pos to max_pos"):
        active.wait()


def test_move_grip_during_positioning_is_refused(active):
    active.move(30_000, FAST, WEAK)
    active.move(0, FAST, WEAK)
    with pytest.raises(GripperFault, match="refused"):
        active.wait()


# -- the line -------------------------------------------------------------------------------------


@pytest.mark.parametrize("mishap", [lost, half, flipped])
def test_state_answer_lost_or_damaged_is_asked_for_again(rig, active, mishap):
    rig.line.mishaps = [mishap]
    assert active.state().width_um == EGU.stroke_um
    assert rig.reports == ["no answer", "read repeated"]


@pytest.mark.parametrize("holds", [False, True])
@pytest.mark.parametrize("at", range(8))
def test_move_with_lost_answer_writes_soon_after_reading_status(rig, active, at, holds):
    """If the answer to a write is lost, the driver first reads the request back, and then writes again."""
    if holds:
        hold(rig, active)
    looked, since = [], []
    read, write = rig.model.read, rig.model.write

    def watched_read(name, now_s):
        if name in ("plc_sync_input", "plc_sync_output"):
            looked.append((name, now_s))
        return read(name, now_s)

    def watched_write(name, data, now_s):
        since.append((looked[-1][0], now_s - looked[-1][1]))
        return write(name, data, now_s)

    rig.model.read, rig.model.write = watched_read, watched_write
    rig.line.mishaps = [lambda request, reply: [Piece(reply)]] * at + [lost]
    active.move(100_000, FAST, WEAK)
    assert active.wait().width_um == 100_000
    assert since[0][0] == "plc_sync_input"
    assert all(seconds < 0.5 for _, seconds in since)


@pytest.mark.parametrize("mishap", [lost, half, flipped])
def test_state_without_sound_answer_times_out(rig, active, mishap):
    rig.line.mishaps = [mishap] * 100
    before = rig.clock.now()
    with pytest.raises(LinkTimeout, match=r"did not answer.*slave id 12"):
        active.state()
    assert rig.clock.now() - before < 3.0


def test_state_echo_is_not_taken_for_answer(rig, active):
    rig.line.mishaps = [echoed] * 2
    assert active.state().width_um == EGU.stroke_um
    assert rig.reports == []


def test_gripper_late_answer_is_not_taken_for_later_one(rig, active):
    active.move(100_000, FAST, WEAK)
    active.wait()
    rig.line.mishaps = [late]
    active.state()
    active.move(60_000, FAST, WEAK)
    assert active.wait().width_um == 60_000
    assert active.state().width_um == 60_000


@pytest.mark.parametrize("mishap", [lost, flipped])
def test_move_with_lost_write_answer_commands_once(rig, active, mishap):
    toggles = []
    obey = rig.model._received
    rig.model._received = lambda: (toggles.append(1), obey())
    # `move` first reads the status and the request; the third answer is that to its write.
    rig.line.mishaps = [lambda request, reply: [Piece(reply)]] * 2 + [mishap]
    active.move(60_000, FAST, WEAK)
    assert active.wait().width_um == 60_000
    assert len(toggles) == 1
    assert "write unanswered" in rig.reports


def test_gripper_idle_is_polled_and_keeps_part(rig, active):
    hold(rig, active)
    rig.clock.sleep(30 * SILENCE_S)
    state = active.state()
    assert (state.fault, state.object) == (0, ObjectState.CLOSING)
    assert ALIVE_S < SILENCE_S / 2


def test_gripper_not_polled_reports_lost_communication_until_activated(rig, active):
    active.close()
    rig.clock.sleep(2 * SILENCE_S)
    again = rig.connect()
    assert "ERR_COMM_LOST" in again.state().fault_text
    again.activate()
    assert again.state().activated


def test_gripper_failed_keep_alive_is_not_reported():
    rig = VirtualSchunk(silence_s=math.inf)
    gripper = rig.connect()
    gripper.activate()
    rig.line.mishaps = [lost] * 3
    rig.clock.sleep(10 * ALIVE_S)
    assert rig.reports == []
    assert gripper.state().activated


# -- ports and models -----------------------------------------------------------------------------


def test_gripper_profile_of_another_stroke_is_refused(rig):
    with pytest.raises(PortError, match="opens to 120 mm, a schunk-egk to 53 mm"):
        rig.connect(EGK)


def test_gripper_without_profile_takes_that_of_module():
    assert VirtualSchunk("schunk-egk").connect().profile is EGK
    assert VirtualSchunk("schunk-egu").connect().profile is EGU


@pytest.mark.parametrize("settings", ["unit=0", "unit=248", "unit=x", "unit=1&unit=2", "baud=9600"])
def test_gripper_port_setting_not_understood_is_refused(rig, settings):
    with pytest.raises(PortError, match="is not understood"):
        open_port(f"schunk:///dev/x?{settings}", rig.pace, print, read_only=False, profile=None)
