"""The gripper driver on a virtual clock: activation, stale flags, stops, deadlines."""

import random

import pytest
from direct_gripper import TRANSACTION_S, active, connect, reset

from drivers.errors import GripperFault, LinkError
from drivers.robotiq.registers import OUTPUT_FIELDS, unpack


def test_activate_resets_first_and_takes_seconds():
    link, gripper = reset()
    gripper.activate()
    assert [unpack(OUTPUT_FIELDS, block)["rACT"] for block in link.writes] == [0, 1]
    assert all(unpack(OUTPUT_FIELDS, block)["rGTO"] == 0 for block in link.writes)
    assert gripper.state().activated
    assert 1.0 < link.clock.time - 100.0 < 15.0


def test_activate_active_gripper_writes_nothing():
    link, gripper = active()
    gripper.activate()
    assert link.writes == []


def test_activate_already_under_way_is_waited_for():
    link, first = reset()
    link.model.write_output(0, bytes((1, 0, 0, 0, 0, 0)), link.clock.time)
    first.activate()
    assert link.writes == []
    assert first.state().activated


def test_gripper_latched_fault_stays_until_activated():
    link, gripper = reset(contact=150)
    with pytest.raises(GripperFault, match="0x0D"):
        gripper.activate()
    link.writes.clear()
    link.contact = None
    for call in (gripper.state, gripper.stop):
        call()
        assert gripper.state().fault == 0x0D
    with pytest.raises(GripperFault, match="0x0D"):
        gripper.move(255, 255, 0)
    assert all(unpack(OUTPUT_FIELDS, block)["rACT"] == 1 for block in link.writes)
    gripper.activate()
    assert gripper.state().activated


def test_activate_active_gripper_with_latched_fault_resets_it():
    link, gripper = active()
    link.model.fail(0x0E, link.clock.now())
    gripper.activate()
    assert [unpack(OUTPUT_FIELDS, block)["rACT"] for block in link.writes] == [0, 1]
    seen = gripper.state()
    assert (seen.activated, seen.fault) == (True, 0)


def test_activate_never_finishing_raises_fault_at_deadline():
    link, gripper = reset()
    link.frozen = bytes((0x11, 0, 0, 0, 0, 0))
    with pytest.raises(GripperFault, match="not done activating"):
        gripper.activate()
    assert 15.0 < link.clock.time - 100.0 < 17.0


@pytest.mark.parametrize("seed", range(6))
def test_wait_with_any_lag_returns_final_position(seed):
    link, gripper = active(seed=seed)
    rng = random.Random(seed)
    for _ in range(30):
        link.contact = rng.choice([None, rng.randrange(60, 229)])
        target = rng.choice([255, 0, rng.randrange(4, 231)])
        gripper.move(target, rng.randrange(256), rng.randrange(256))
        settled = gripper.wait()
        assert settled.position_counts == round(link.model._stroke.at(1e12))
        assert settled.echo_counts == target
        assert settled.object_flag in {2, 3}
        gripper.move(0, 255, 0)
        assert gripper.wait().position_counts == 3


def test_wait_reports_contact_current_and_time():
    _, gripper = active(contact=174)
    gripper.move(255, 255, 100)
    settled = gripper.wait()
    assert (settled.position_counts, settled.object_flag, settled.echo_counts) == (174, 2, 255)
    assert settled.current_ma > 0
    assert settled.seconds == pytest.approx((174 - 3) * 85 / 227 / 150, abs=0.1)


def test_stop_by_any_connection_keeps_request_and_part():
    link, gripper = active(contact=174)
    gripper.move(255, 255, 50)
    gripper.wait()
    assert len(link.writes) == 1
    for holding in (gripper, connect(link)):
        holding.stop()
        image = unpack(OUTPUT_FIELDS, link.writes[-1])
        assert (image["rACT"], image["rGTO"], image["rPR"]) == (1, 0, 255)
        seen = holding.state()
        assert (seen.position_counts, seen.activated) == (174, True)


def test_stop_during_activation_ends_sweep():
    link, gripper = reset()
    link.write(bytes((1, 0, 0, 0, 0, 0)))
    link.clock.sleep(1.5)
    gripper.stop()
    here = gripper.state()
    link.clock.sleep(3.0)
    assert gripper.state() == here
    assert (here.enabled, here.activated) == (False, False)
    assert 3 < here.position_counts < 230


def test_stop_after_latched_fault_keeps_it():
    link, gripper = active()
    link.model.fail(0x0E, link.clock.now())
    gripper.stop()
    assert gripper.state().fault == 0x0E


def test_wait_process_stopped_after_arrival_returns_position():
    link, gripper = active()
    gripper.move(255, 0, 0)
    read = link.read

    def stopped_at_its_end():
        block = read()
        if block[0] & 0xC0 == 0xC0:  # the jaws have arrived
            link.read = read
            link.clock.sleep(60.0)
        return block

    link.read = stopped_at_its_end
    assert gripper.wait().position_counts == 230


@pytest.mark.parametrize(
    ("block", "message"),
    [
        (bytes((0x39, 0, 0, 200, 50, 10)), "not done moving"),  # gOBJ stuck at moving
        (bytes((0xF9, 0, 0, 0, 3, 0)), "not done taking the request"),  # no echo
        (bytes((0x31, 0, 0, 200, 50, 0)), "not done moving"),  # rGTO gone
        (bytes((0x39, 0, 0x0E, 200, 50, 90)), "0x0E"),
        (bytes((0x00, 0, 0, 200, 50, 0)), "not active"),
    ],
)
def test_wait_unfinished_registers_raise_fault_within_deadline(block, message):
    link, gripper = active()
    gripper.move(200, 255, 0)
    link.frozen = block
    began = link.clock.time
    with pytest.raises(GripperFault, match=message):
        gripper.wait()
    assert link.clock.time - began < 5.0


def test_wait_count_never_settling_raises_fault():
    link, gripper = active()
    gripper.move(200, 255, 0)
    counts = iter(range(100, 10_000))

    def restless():
        link.clock.sleep(TRANSACTION_S)
        return bytes((0xB9, 0, 0, 200, next(counts) % 230, 0))

    link.read = restless
    with pytest.raises(GripperFault, match="does not settle"):
        gripper.wait()


@pytest.mark.parametrize("asked", [3, 120, 255])
@pytest.mark.parametrize("spike", [0, 128, 255])
def test_move_after_wrong_count_reading_ends_at_target_or_part(asked, spike):
    link, gripper = active(contact=60)
    gripper.move(30, 0, 0)
    gripper.wait()
    right = link.read

    def wrong():
        link.read = right
        block = bytearray(right())
        block[4] = spike
        return bytes(block)

    link.read = wrong
    gripper.move(asked, 0, 0)
    assert gripper.wait().position_counts == min(asked, 60)


def test_gripper_link_error_is_passed_on():
    link, gripper = active()

    def broken():
        raise LinkError("gone")

    link.read = broken
    for call in (gripper.state, gripper.activate, gripper.stop):
        with pytest.raises(LinkError, match="gone"):
            call()


def test_wait_request_changed_by_another_program_raises_fault():
    """The jaws settle where another program requested, so that their width is not the one to report."""
    link, gripper = active()
    gripper.move(200, 255, 0)
    ours, theirs = bytes((0xF9, 0, 0, 200, 199, 0)), bytes((0xF9, 0, 0, 120, 199, 0))
    blocks = iter([ours] * 3)
    link.read = lambda: (link.clock.sleep(TRANSACTION_S), next(blocks, theirs))[1]
    with pytest.raises(GripperFault, match="is another program using it"):
        gripper.wait()
    assert len(link.writes) == 1
