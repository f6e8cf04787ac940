"""The gripper driver when the answer to a write is lost, or the gripper loses its power."""

import random

import pytest
from direct_gripper import active

from drivers.errors import GripperFault, LinkTimeout
from drivers.robotiq.registers import OUTPUT_FIELDS, unpack
from drivers.sim.devices.gripper import GripperModel


def lose(link, times=1, before=lambda block: None):
    """Lose the next writes; `before` is what happens first."""

    def lost(block):
        nonlocal times
        before(block)
        times -= 1
        if not times:
            link.on_write = None
        raise LinkTimeout("lost")

    link.on_write = lost


def arrive(link):
    """A function that lets a write arrive."""
    return lambda block: link.model.write_output(0, block, link.clock.time)


def power_cycle(link):
    link.model = GripperModel(random.Random(9), link)


def test_a_write_that_arrived_without_its_answer_is_written_again_and_changes_nothing():
    link, gripper = active(contact=174)
    # The fingers are on their way, or have met the part.
    lose(link, 2, lambda block: (arrive(link)(block), link.clock.sleep(0.4)))
    gripper.move(255, 255, 0)
    assert len(link.writes) == 3
    assert len(set(link.writes)) == 1
    assert gripper.wait().position_counts == 174
    assert link.asked == 1


def test_a_write_that_only_raises_the_force_is_repeated_when_it_is_lost():
    """The position is the same, so the echoes tell of the write before."""
    link, gripper = active(contact=174)
    gripper.move(255, 0, 0)
    gripper.wait()
    lose(link)
    gripper.move(255, 0, 200)
    assert unpack(OUTPUT_FIELDS, link.model.read_output()[:6])["rFR"] == 200
    assert gripper.wait().position_counts == 174


def test_a_write_that_is_never_acknowledged_is_no_command():
    link, gripper = active()
    lose(link, 3, arrive(link))
    with pytest.raises(LinkTimeout):
        gripper.move(100, 255, 0)
    assert len(link.writes) == 3


def test_a_write_that_did_not_arrive_is_repeated_once_after_a_look():
    link, gripper = active()
    lose(link)
    gripper.move(100, 255, 0)
    assert len(link.writes) == 2
    assert gripper.wait().position_counts == 100


def test_a_write_lost_to_a_power_cut_is_not_repeated():
    """Repeating it would set rACT in a reset gripper: the activation sweep."""
    link, gripper = active()
    lose(link, before=lambda block: power_cycle(link))
    with pytest.raises(GripperFault, match="not active"):
        gripper.move(100, 255, 0)
    assert len(link.writes) == 1
    assert not gripper.state().activating


def test_a_stop_lost_to_a_power_cut_does_not_start_the_sweep():
    link, gripper = active(contact=174)
    gripper.move(255, 0, 0)
    lose(link, before=lambda block: power_cycle(link))
    with pytest.raises(GripperFault, match="not active"):
        gripper.stop()
    assert not gripper.state().activating


def test_stop_after_a_power_cut_does_not_start_the_sweep():
    link, gripper = active()
    power_cycle(link)
    link.writes.clear()
    gripper.stop()
    assert link.writes == []
