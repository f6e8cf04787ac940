"""The driver of DH grippers against a simulated gripper in virtual time, also if the line has faults."""

from dataclasses import replace

import pytest
from dh_devices import VirtualDh, close
from refusals import refused_in_a_line

from drivers import connect
from drivers.dh import registers as dh
from drivers.dh.percent import Scale
from drivers.errors import GripperFault, LinkTimeout, PortError
from drivers.ports import ObjectState
from runtime.table import profile_of

PART_MM = 38.0  # position 400 of the AG-95


def ready(seed=1, contact_mm=PART_MM):
    """A simulated device and a driver that has initialised it."""
    device = VirtualDh(contact_mm=contact_mm, seed=seed)
    return device, device.ready()


@pytest.mark.parametrize("seed", range(6))
def test_wait_late_state_register_ends_no_move_early(seed):
    """For some cycles after a command, the register shows the state in which the previous move ended."""
    _, gripper = ready(seed)
    for width_um, expected_um in ((0, 38_000), (95_000, 95_000), (60_040, 60_040), (0, 38_000)):
        gripper.move(width_um, 135.0, 45.0)
        assert gripper.wait().width_um == pytest.approx(expected_um, abs=48)


@pytest.mark.parametrize("width_um", [0, 20_045, 95_000])
@pytest.mark.parametrize("spike", [0, 500, 1000])
def test_move_after_wrong_position_reading_ends_at_target_or_part(width_um, spike):
    device, gripper = ready()
    gripper.move(60_040, 135.0, 45.0)
    gripper.wait()
    right = device.device._position

    def wrong():
        device.device._position = right
        return spike

    device.device._position = wrong
    gripper.move(width_um, 2.0, 45.0)
    assert gripper.wait().width_um == max(width_um, 38_000)


def test_state_after_dropped_part_is_closed_at_target():
    device, gripper = ready()
    close(gripper)
    gripper.wait()
    device.device.lose_object(device.clock.now())
    device.clock.sleep(1.0)
    seen = gripper.state()
    assert (seen.width_um, seen.object) == (0, ObjectState.AT_TARGET)


def test_wait_power_lost_during_move_raises_fault():
    device, gripper = ready(contact_mm=None)
    close(gripper, 1.4)
    device.device.power_cycle(device.clock.now() + 1.0)
    with pytest.raises(GripperFault, match="not initialised"):
        gripper.wait()


def test_stop_stands_still_and_keeps_held_part():
    device, gripper = ready()
    close(gripper, 20.0)
    device.clock.sleep(0.5)
    gripper.stop()
    here = gripper.state()
    assert PART_MM * 1000 < here.width_um < 95_000
    device.clock.sleep(1.0)
    assert gripper.state().width_um == here.width_um
    close(gripper)
    gripper.wait()
    writes = device.device.writes
    gripper.stop()
    assert device.device.writes == writes
    assert gripper.state().object is ObjectState.CLOSING


def test_stop_right_after_move_stops_despite_earlier_grip():
    device, gripper = ready()
    close(gripper)
    gripper.wait()
    gripper.move(95_000, 1.4, 45.0)
    gripper.stop()
    here = gripper.state().width_um
    device.clock.sleep(2.0)
    assert gripper.state().width_um == here < 40_000


def test_stop_during_initialisation_raises_fault():
    device = VirtualDh()
    gripper = device.connect()
    device.device.write(dh.INITIALISATION, dh.CALIBRATE, device.clock.now())
    with pytest.raises(GripperFault, match="cannot be stopped"):
        gripper.stop()


def test_move_settings_do_not_exceed_those_asked_for():
    device, gripper = ready(contact_mm=None)
    for speed, force in ((1.0, 1.0), (50.0, 80.0), (1000.0, 1000.0)):
        gripper.move(50_000, speed, force)
        gripper.wait()
        percent = device.device.read(dh.SPEED, device.clock.now())
        scale = Scale(device.profile)
        assert scale.speed_mm_s(percent) <= max(speed, device.profile.speed_mm_s[0])
        assert percent == 100 or scale.speed_mm_s(percent + 1) > speed
        assert 20 <= device.device.read(dh.FORCE, device.clock.now()) <= 100


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("request_lost", 0),
        ("reply_lost", 0),
        ("reply_truncated", 4),  # half a frame
        ("reply_truncated", 1),
        ("reply_corrupted", 30),  # a CRC error
        ("wrong_id", 7),
        ("reply_late", 0.7),
    ],
)
def test_gripper_brief_line_fault_is_retried_and_lasting_one_times_out(kind, value):
    device, gripper = ready()
    device.fault(kind, length=2, value=value)
    close(gripper)
    assert gripper.wait().width_um == 38_000
    assert device.incidents
    device.fault(kind, value=value)
    with pytest.raises(LinkTimeout):
        gripper.state()


@pytest.mark.parametrize(("kind", "value"), [("noise", 9), ("echo", 0), ("reply_twice", 0)])
def test_gripper_extra_bytes_on_line_change_nothing(kind, value):
    device, gripper = ready()
    device.fault(kind, value=value)
    close(gripper)
    assert gripper.wait().width_um == 38_000


def test_state_unknown_initialisation_code_raises_fault():
    device, gripper = ready(contact_mm=None)
    device.device._initialised = 9
    with pytest.raises(GripperFault, match="check that it is one"):
        gripper.state()


def test_scale_unsuitable_profile_is_refused():
    with pytest.raises(PortError, match="is no gripper of DH-Robotics"):
        Scale(profile_of("robotiq-2f-85"))
    finer = replace(profile_of("dh-ag95"), resolution_um=10.0)
    with pytest.raises(PortError, match=r"of 9500 steps .* resolution"):
        Scale(finer)


@pytest.mark.parametrize(
    "port",
    ["dh://", "dh:///dev/ttyS0?unit=0", "dh:///dev/ttyS0?baud=9600", "dh://host", "dh:///dev/null"],
)
def test_connect_gripper_malformed_dh_port_is_refused_in_a_line(port):
    with refused_in_a_line(PortError):
        connect.gripper(port)
