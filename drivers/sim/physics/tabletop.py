"""The part on the table, moved by the fingers as a world computes, or a fixed block in its place."""

import math
import random
from typing import NamedTuple

from drivers.planar import Pose2, compose, relative
from drivers.ports import Truth
from drivers.sim.faults import Channel, Desk
from drivers.sim.physics.scene import Setting

# Deviation up to which a motion is straight ahead, given the rounded readings of an arm.
AHEAD_MM, AHEAD_RAD = 0.05, 0.005
BESIDE: Pose2 = (0.0, 70.0, 0.8)  # pose of a second part, in the frame of the first


class Look(NamedTuple):
    """What a camera under the table has in view."""

    pose: Pose2 | None  # pose of the part; None: there is no part, or the world has no poses
    strange: bool = False  # whether the part is a foreign part
    second: Pose2 | None = None  # pose of a second part; None: there is none
    covered: bool = False  # whether something covers the lens
    moved_mm: float = 0.0  # displacement of the camera
    hypothesis: int = 0  # index of the part's hypothesis


class TableTop:
    """The part on the table; moves it as the fingers push, hold or release it.

    Args:
        setting: part and world.
        seed: seed of parts, world and encoder noise.
        desk: gives the faults of the part; a closing of the jaws is one event.
    """

    def __init__(self, setting: Setting, seed: int, desk: Desk) -> None:
        self.geometry, self._setting = setting.geometry, setting
        self._seed = seed
        self._desk = desk
        self._worlds = setting.make_worlds(seed)
        self._shares = [share for share, _ in setting.parts]
        self._noise = random.Random(f"{seed}/encoder")
        self.part = -1
        self.next_part()

    def next_part(self) -> int:
        """Puts the next part on the table, and returns its number.

        The pose of the part depends only on the seed and this number.
        """
        self.part += 1
        self.squeezes = self.crashes = self.drops = 0
        self.status = "untouched"
        self.pose, self.hypothesis = self._lay(self.part), self._drawn(self.part)
        self._world = self._worlds[self.hypothesis]
        self._coming = (self.pose, self.status)
        self._hand: Pose2 | None = None  # where the current squeeze met the part
        self._held: Pose2 | None = None
        self._lifted = False
        self._desk.begin(self.part)
        return self.part

    def squeeze(self, hand: Pose2) -> float | None:
        """Starts a squeeze at a grasp pose; returns the width at which the part will stop the fingers.

        Returns:
            The width with encoder noise, mm; None: the fingers meet nothing, and the squeeze is complete.
        """
        self._desk.next(Channel.SCENE)
        for fault in self._desk.beginning(Channel.SCENE):
            if fault.kind == "part_bumped":
                self._bump(fault.value)
        final, width_mm, status = self._world.squeeze(relative(hand, self.pose))
        if self._desk.holds("part_missing"):
            final, width_mm, status = relative(hand, self.pose), 0.0, "untouched"
        touched = width_mm > 0.0 and status != "untouched"
        held = self._desk.holding(Channel.SCENE)
        width_mm += sum(fault.value for fault in held if fault.kind in {"wrong_part", "two_parts"})
        touched = touched and width_mm > 0.0
        self._coming, self._hand = (compose(hand, final), status), hand if touched else None
        if not touched:
            self.gripped()
            return None
        return width_mm + self._noise.gauss(0.0, self.geometry.gripper.noise_um / 1000.0)

    def gripped(self) -> None:
        """Completes the squeeze: moves the part to the final pose that the world has computed.

        If the fingers met the part, they hold it from now on.
        """
        self.pose, self.status = self._coming
        self._held = None if self._hand is None else relative(self._hand, self.pose)
        self.squeezes += 1

    def released(self) -> None:
        """Releases the part; if it was lifted, it falls straight down, which counts as a drop."""
        if self._held is not None and self._lifted:
            self.drops += 1
        self._held, self._lifted = None, False

    def carried(self, hand: Pose2, *, lifted: bool) -> bool:
        """Moves the part, if it is held, with the hand to a grasp pose.

        Returns:
            False if the part was to be lifted but slipped out of the fingers, otherwise True.
        """
        if self._held is None:
            return True
        if lifted and self._desk.holds("part_slips"):
            self._held, self._lifted = None, False
            return False
        self.pose, self._lifted = compose(hand, self._held), lifted
        return True

    def pushed(self, start: Pose2, end: Pose2, opening_mm: float) -> None:
        """Pushes the part if the hand moved straight along its own x on the table, with empty jaws.

        The part stays after any other motion, and in a world that cannot push.

        Args:
            start: grasp pose before the motion.
            end: grasp pose after the motion.
            opening_mm: opening of the jaws.
        """
        push = getattr(self._world, "push", None)
        way_mm, aside_mm, turn_rad = relative(start, end)
        straight = abs(math.remainder(turn_rad, math.tau)) < AHEAD_RAD
        ahead = way_mm > AHEAD_MM and abs(aside_mm) < AHEAD_MM and straight
        if push is None or not ahead or self._held is not None or self._desk.holds("part_missing"):
            return
        self.pose = compose(start, push(relative(start, self.pose), opening_mm, way_mm))

    def placed(self, hand: Pose2, opening_mm: float) -> None:
        """Counts a crash if fingers that came down at a grasp pose collide with the part."""
        if self._held is not None or self._desk.holds("part_missing"):
            return
        collides = getattr(self._world, "collides", None)
        if collides is not None and collides(relative(hand, self.pose), opening_mm):
            self.crashes += 1

    def truth(self) -> Truth:
        """Returns the ground truth about the part."""
        x, y, theta = map(float, self.pose) if self._setting.truthful else (math.nan,) * 3
        covered = self._desk.holds("camera_covered") is not None
        counts = self.squeezes, self.crashes
        return Truth(x, y, theta, *counts, self.status, covered, self.hypothesis)

    def look(self) -> Look:
        """What the camera has in view now, with the effects of the current faults."""
        there = self._setting.truthful and not self._desk.holds("part_missing")
        moved, two = self._desk.holds("camera_moved"), self._desk.holds("two_parts")
        wrong, covered = self._desk.holds("wrong_part"), self._desk.holds("camera_covered")
        second = compose(self.pose, BESIDE) if two and there else None
        moved_mm = 0.0 if moved is None else moved.value
        parts = (self.pose if there else None, wrong is not None, second)
        return Look(*parts, covered is not None, moved_mm, self.hypothesis)

    def _bump(self, distance_mm: float) -> None:
        bearing = random.Random(f"{self._seed}/bump/{self.part}").uniform(-math.pi, math.pi)
        x, y, turn = self.pose
        self.pose = (x + distance_mm * math.cos(bearing), y + distance_mm * math.sin(bearing), turn)

    def _drawn(self, part: int) -> int:
        """Draws which of the possible parts lies on the table, by their shares; returns its index."""
        if not self._shares:
            return 0
        draw = random.Random(f"{self._seed}/hypothesis/{part}")
        return draw.choices(range(len(self._shares)), self._shares)[0]

    def _lay(self, part: int) -> Pose2:
        draw = random.Random(f"{self._seed}/part/{part}")
        radius = self.geometry.radius_mm * math.sqrt(draw.random())
        bearing = draw.uniform(-math.pi, math.pi)
        turn = draw.uniform(-self.geometry.halfwidth_rad, self.geometry.halfwidth_rad)
        return (radius * math.cos(bearing), radius * math.sin(bearing), turn)


class Vice(TableTop):
    """A table without parts; the block of the setting is fixed to it."""

    def squeeze(self, hand: Pose2) -> float | None:
        """Counts a squeeze; returns the width at which the first finger touches the block: both then stop.

        Returns:
            The width with encoder noise, mm; None: the hand is beside the block.
        """
        self.squeezes += 1
        needed_mm = self._needed(hand)
        if needed_mm is None:
            return None
        return needed_mm + self._noise.gauss(0.0, self.geometry.gripper.noise_um / 1000.0)

    def gripped(self) -> None:
        """Does nothing: the block is fixed."""

    def placed(self, hand: Pose2, opening_mm: float) -> None:
        """Counts a crash if the fingers come down on the block."""
        self.crashes += (self._needed(hand) or 0.0) > opening_mm

    def _needed(self, hand: Pose2) -> float | None:
        """Width at which the first finger touches the block, mm; None if the hand is beside the block."""
        block = self._setting.block
        assert block is not None
        x, y = block.x_mm - hand[0], block.y_mm - hand[1]
        c, s = math.cos(hand[2]), math.sin(hand[2])
        wide_mm = block.width_mm * (abs(c) + abs(s))  # extent along the hand's axes
        return wide_mm + 2.0 * abs(c * y - s * x) if abs(c * x + s * y) < wide_mm / 2.0 else None
