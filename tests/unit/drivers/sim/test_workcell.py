"""Gripper, arm and part together: a held part moves with the hand, a dropped one stays."""

import math

import pytest
from direct_gripper import Counted
from fake_scene import FakeWorld, setting

from drivers.errors import ArmError, GripperFault, LinkError, PortError
from drivers.sim.faults import Fault, Listed
from drivers.sim.virtual.cell import VirtualCell
from drivers.sim.virtual.clock import VirtualClock

LOW, HIGH = 10.0, 60.0
CONTACT, ARRIVED = 2, 3  # object flags


class Hands:
    """A simulated cell with its drivers. The gripper is active, and part 1 lies on the table."""

    def __init__(self, *faults, world=None):
        self.cell = VirtualCell(setting(world), 3, Listed(faults))
        self.gripper, self.arm = Counted(self.cell.gripper()), self.cell.arm()
        self.gripper.activate()
        self.cell.scene.next_part()

    def go(self, x, y, z, angle=0.0):
        self.arm.move_linear((x, y, z, angle), 200.0)

    def jaws(self, counts):
        self.gripper.move(counts, 200, 50)
        return self.gripper.wait()

    def grip(self, x=0.0, y=0.0, angle=0.0):
        self.go(x, y, HIGH, angle)
        self.go(x, y, LOW, angle)
        return self.jaws(255)

    def pose(self):
        truth = self.cell.scene.truth()
        return (truth.x_mm, truth.y_mm, truth.theta_rad)


def test_workcell_held_part_moves_and_turns_with_hand():
    hands = Hands()
    hands.grip(1.0, 2.0, 0.3)
    x, y, turn = hands.pose()
    assert -math.sin(0.3) * (x - 1.0) + math.cos(0.3) * (y - 2.0) == pytest.approx(0.0, abs=1e-3)
    hands.go(31.0, -8.0, LOW, 0.3)
    assert hands.pose() == pytest.approx((x + 30.0, y - 10.0, turn), abs=1e-3)
    hands.go(31.0, -8.0, LOW, 0.3 + math.pi / 2)
    x_now, y_now, turn_now = hands.pose()
    off_mm = math.hypot(x - 1.0, y - 2.0)
    assert math.hypot(x_now - 31.0, y_now + 8.0) == pytest.approx(off_mm, abs=1e-3)
    assert turn_now == pytest.approx(turn + math.pi / 2, abs=1e-3)


def test_workcell_jaws_closing_above_part_meet_nothing():
    hands = Hands()
    hands.grip()
    before = hands.pose()
    hands.jaws(100)
    hands.go(0.0, 0.0, LOW + 12.0)
    assert hands.jaws(150).object_flag == ARRIVED
    assert hands.pose() == before
    hands.jaws(0)
    hands.go(0.0, 0.0, LOW + 5.0)
    assert hands.jaws(255).object_flag == CONTACT


def test_workcell_released_part_stays_where_put():
    hands = Hands()
    hands.grip()
    hands.go(20.0, 0.0, HIGH)
    hands.go(20.0, 0.0, LOW)
    before = hands.pose()
    hands.jaws(0)
    hands.go(-40.0, 10.0, HIGH)
    assert hands.pose() == before
    assert hands.cell.works.table.drops == 0


def test_workcell_part_released_in_air_falls_and_is_counted():
    hands = Hands()
    hands.grip()
    hands.go(20.0, 0.0, HIGH)
    hands.jaws(0)
    assert hands.cell.works.table.drops == 1
    assert hands.pose()[0] == pytest.approx(20.0, abs=6.0)


def test_workcell_part_slipping_during_lift_stays_and_jaws_close():
    hands = Hands(Fault("part_slips", 1, length=9))
    held = hands.grip()
    assert held.object_flag == CONTACT
    before = hands.pose()
    hands.go(0.0, 0.0, HIGH)
    hands.cell.clock.sleep(1.0)
    seen = hands.gripper.state()
    assert (seen.object_flag, seen.position_counts) == (ARRIVED, 230)
    hands.go(30.0, 0.0, HIGH)
    assert hands.pose() == before


def test_workcell_lost_grip_lets_jaws_close():
    hands = Hands(Fault("grip_lost", 1, at=60))
    hands.grip()
    for _ in range(60):
        hands.cell.clock.sleep(0.05)
        seen = hands.gripper.state()
    assert (seen.object_flag, seen.position_counts) == (ARRIVED, 230)


def test_workcell_bumped_part_moves_before_squeeze():
    class Recorder(FakeWorld):
        def __init__(self):
            self.seen = []

        def squeeze(self, pose_hand):
            self.seen.append(pose_hand)
            return super().squeeze(pose_hand)

    world = Recorder()
    Hands(world=world).grip()
    Hands(Fault("part_bumped", 1, value=12.0), world=world).grip()
    first, second = world.seen
    assert math.dist(first[:2], second[:2]) == pytest.approx(12.0, abs=1e-6)
    assert first[2] == second[2]


@pytest.mark.parametrize(("kind", "wider_mm"), [("wrong_part", -3.0), ("two_parts", 9.0)])
def test_workcell_wrong_part_or_two_parts_change_width(kind, wider_mm):
    sound = Hands().grip().position_counts
    other = Hands(Fault(kind, 1, value=wider_mm)).grip().position_counts
    assert (sound - other) * 85.0 / 227.0 == pytest.approx(wider_mm, abs=0.4)


def test_workcell_missing_part_is_not_met():
    hands = Hands(Fault("part_missing", 1, length=9))
    assert hands.grip().object_flag == ARRIVED
    hands.jaws(0)
    hands.go(0.0, 39.0, HIGH)
    hands.go(0.0, 39.0, LOW)
    assert hands.cell.scene.truth().crashes == 0


def test_workcell_covered_camera_shows_in_truth():
    hands = Hands(Fault("camera_covered", 1))
    assert not hands.cell.scene.truth().covered
    hands.grip()
    assert hands.cell.scene.truth().covered


@pytest.mark.parametrize("code", [0x0A, 0x0C, 0x0D, 0x0E, 0x0F])
def test_workcell_major_fault_stops_jaws_until_activated(code):
    hands = Hands(Fault(f"gflt_{code:02x}", 1, at=3))
    hands.gripper.move(255, 0, 0)
    with pytest.raises(GripperFault, match=f"0x{code:02X}"):
        hands.gripper.wait()
    here = hands.gripper.state().position_counts
    hands.cell.clock.sleep(0.9)
    assert hands.gripper.state().position_counts == here < 230
    hands.gripper.activate()
    assert hands.jaws(100).position_counts == 100


def test_workcell_automatic_release_opens_and_latches():
    hands = Hands(Fault("gflt_0b", 1, at=40))
    hands.grip()
    while hands.gripper.state().fault == 0:
        hands.cell.clock.sleep(0.05)
    assert hands.gripper.state().fault == 0x0B
    for _ in range(100):
        hands.cell.clock.sleep(0.05)
        seen = hands.gripper.state()
    assert (seen.fault, seen.position_counts) == (0x0F, 3)


@pytest.mark.parametrize(
    ("kind", "reason"), [("unplugged", "does not exist"), ("permission_lost", "no permission")]
)
def test_virtual_cell_lost_port_is_refused_with_reason(kind, reason):
    hands = Hands(Fault(kind, 1))
    with pytest.raises(LinkError, match="broke"):
        hands.gripper.state()
    with pytest.raises(PortError, match=reason):
        hands.cell.gripper()


def test_arm_after_broken_connection_ignores_stale_acknowledgement():
    hands = Hands(Fault("arm_disconnect", 1, at=4))
    hands.go(0.0, 0.0, 80.0)
    with pytest.raises(ArmError, match="connection broke"):
        hands.go(50.0, 0.0, 80.0)
    hands.cell.clock.sleep(5.0)
    again = hands.cell.arm()
    assert again.pose().x_mm == pytest.approx(50.0)
    again.close()
    assert hands.cell.arm().pose().x_mm == pytest.approx(50.0)


def test_workcell_hand_not_pointing_down_meets_nothing():
    hands = Hands()
    hands.arm._ask(1, ("0", "0", "10", "0.7071068", "0.7071068", "0", "0"), 60.0)
    assert hands.jaws(255).object_flag == ARRIVED


# -- time -----------------------------------------------------------------------------------------


def test_virtual_clock_runs_events_in_order_and_never_goes_back():
    clock, seen = VirtualClock(), []
    for moment in (2.0, 1.0, 1.0, 5.0):
        clock.at(moment, lambda moment=moment: seen.append((moment, clock.now())))
    clock.sleep(3.0)
    assert seen == [(1.0, 1.0), (1.0, 1.0), (2.0, 2.0)]
    assert (clock.now(), clock.next_s) == (3.0, 5.0)
    clock.sleep(-1.0)
    clock.advance(1.0)
    assert clock.now() == 3.0


def test_virtual_clock_idle_ends_at_next_change_or_limit():
    clock = VirtualClock()
    coming = [7.0]
    clock.watch(lambda: coming[0])
    clock.idle(0.005, 2.0)
    assert clock.now() == 2.0
    clock.idle(0.005, 100.0)
    assert clock.now() == pytest.approx(7.0, abs=1e-5)
    clock.idle(0.005, 100.0)
    assert clock.now() == pytest.approx(7.005, abs=1e-5)
    coming[0] = math.inf
    clock.idle(0.005, 50.0)
    assert clock.now() == 50.0
