"""pyDHgripper, a client that others wrote for real DH grippers, drives the simulated gripper unchanged."""

import contextlib

import pytest
from gripper_rigs import Dh
from programs import until
from pyDHgripper import AG95, PGE

SCALE = 20.0


@pytest.fixture
def device():
    with contextlib.closing(Dh("dh-ag95", SCALE)) as result:
        yield result


@pytest.fixture
def client(device):
    result = AG95(device.path)
    yield result
    result.ser.close()


def settled(client):
    """Waits until the client reads a state other than moving; returns the state."""
    return until(client.read_state)


def test_dh_model_pydhgripper_connected_reads_open(client):
    assert client.read_pos() == 1000


def test_dh_model_pydhgripper_moves_to_each_position(client):
    client.set_force(50)
    client.set_vel(60)
    for position in (0, 617):
        client.set_pos(position)
        assert settled(client) == 1
        assert client.read_pos() == position


def test_dh_model_pydhgripper_reads_caught_then_dropped(device, client):
    device.put_part()
    client.set_pos(0)
    assert settled(client) == 2
    assert client.read_pos() == 321
    device.site.call(lambda: device.device.lose_object(device.now()))
    until(lambda: client.read_state() == 3)
    assert client.read_pos() == 0


def test_dh_model_pydhgripper_pge_waits_for_position(device):
    client = PGE(device.path)
    try:
        client.init_dir(0)
        client.init_feedback()
        client.set_pos(120, blocking=True)
        assert client.read_pos() == 120
    finally:
        client.ser.close()


def test_gripper_opened_after_pydhgripper_has_its_state(device, client):
    device.put_part()
    client.set_pos(0)
    settled(client)
    client.ser.close()
    with device.open() as gripper:
        seen = gripper.state()
        assert (seen.activated, seen.width_um, seen.target_um) == (True, device.contact_um, 0)
