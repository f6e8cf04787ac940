"""The gripper driver when a write or its answer is lost, or the gripper loses power."""

import random

import pytest
from direct_gripper import active

from drivers.errors import GripperFault, LinkTimeout
from drivers.robotiq.registers import OUTPUT_FIELDS, unpack
from drivers.sim.devices.gripper import GripperModel


def lose(link, times=1, before=lambda block: None):
    """Lose the next `times` writes. Before each loss, call `before` with the bytes of the write."""

    def lost(block):
        nonlocal times
        before(block)
        times -= 1
        if not times:
            link.on_write = None
        raise LinkTimeout("lost")

    link.on_write = lost


def arrive(link):
    """A function to pass to `lose` as `before`: it delivers the write, so that only its answer is lost."""
    return lambda block: link.model.write_output(0, block, link.clock.time)


def power_cycle(link):
    link.model = GripperModel(random.Random(9), link)


def test_move_unanswered_write_is_repeated_and_grips_once():
    link, gripper = active(contact=174)
    # The fingers move on between the writes, and meet the part.
    lose(link, 2, lambda block: (arrive(link)(block), link.clock.sleep(0.4)))
    gripper.move(255, 255, 0)
    assert len(link.writes) == 3
    assert len(set(link.writes)) == 1
    assert gripper.wait().position_counts == 174
    assert link.asked == 1


def test_move_lost_write_of_force_alone_is_repeated():
    """The position is unchanged, so its echo does not show whether the write arrived."""
    link, gripper = active(contact=174)
    gripper.move(255, 0, 0)
    gripper.wait()
    lose(link)
    gripper.move(255, 0, 200)
    assert unpack(OUTPUT_FIELDS, link.model.read_output()[:6])["rFR"] == 200
    assert gripper.wait().position_counts == 174


def test_move_never_acknowledged_times_out():
    link, gripper = active()
    lose(link, 3, arrive(link))
    with pytest.raises(LinkTimeout):
        gripper.move(100, 255, 0)
    assert len(link.writes) == 3


def test_move_lost_write_is_repeated_once():
    link, gripper = active()
    lose(link)
    gripper.move(100, 255, 0)
    assert len(link.writes) == 2
    assert gripper.wait().position_counts == 100


def test_move_write_lost_to_power_cut_is_not_repeated():
    """A repeated write would set rACT in a reset gripper, and so start the activation sweep."""
    link, gripper = active()
    lose(link, before=lambda block: power_cycle(link))
    with pytest.raises(GripperFault, match="not active"):
        gripper.move(100, 255, 0)
    assert len(link.writes) == 1
    assert not gripper.state().activating


def test_stop_write_lost_to_power_cut_does_not_activate():
    link, gripper = active(contact=174)
    gripper.move(255, 0, 0)
    lose(link, before=lambda block: power_cycle(link))
    with pytest.raises(GripperFault, match="not active"):
        gripper.stop()
    assert not gripper.state().activating


def test_stop_after_power_cut_writes_nothing():
    link, gripper = active()
    power_cycle(link)
    link.writes.clear()
    gripper.stop()
    assert link.writes == []
