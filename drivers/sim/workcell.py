"""Gripper, arm and part of a simulated cell, joined by their interactions, without ports or clocks."""

import math
import random
from collections.abc import Callable, Mapping

from drivers.abb.codec import Pose, ProtocolError, hand_angle
from drivers.planar import Pose2, compose
from drivers.sim.devices.arm import ArmModel
from drivers.sim.devices.jaws import Surroundings
from drivers.sim.faults import Desk, Listed
from drivers.sim.grippers import simulator
from drivers.sim.physics.scene import Setting
from drivers.sim.physics.tabletop import Look, TableTop, Vice
from drivers.sim.wire.line import Line

# in the world: the table's middle is in reach
ARM_BASE = Pose(-300.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0))


class Workcell(Surroundings):
    """Gripper, arm and table of a cell, and their effects on each other.

    Args:
        setting: part and world.
        seed: seed of all random numbers.
        now: returns the simulated time, s.
        faults: schedule of faults; None: no faults.
    """

    def __init__(
        self, setting: Setting, seed: int, now: Callable[[], float], faults: Listed | None = None
    ) -> None:
        geometry = setting.geometry
        self.now = now
        self.desk = Desk(faults or Listed())
        self.table = (TableTop if setting.block is None else Vice)(setting, seed, self.desk)
        self._middle: Pose2 = (0.0, setting.middle_mm, 0.0)
        self.profile = geometry.gripper
        # Whether the hand was low after the last motion, and its pose then.
        self._low, self._stood = False, (0.0, 0.0, 0.0)
        self._height_mm = math.inf
        # Whether the jaws opened since the hand came down, and whether it rose afterwards.
        self._let_go, self._risen = False, False
        self._moves = 0
        self._noise = random.Random(f"{seed}/line")
        ramps = None
        if (line := geometry.acceleration_mm_s2) is not None:
            ramps = (line, math.degrees(line / geometry.turn_radius_mm))
        self.simulator = simulator(self.profile.model)
        lags = random.Random(f"{seed}/gripper")
        self.gripper = self.simulator.model(lags, self, self.profile, self.desk)
        self.arm = ArmModel(ARM_BASE, ramps, self.desk, seed)

    def line(self, *, checked: bool = True) -> Line:
        """Creates a line to the gripper; `checked`: its frames end in a CRC."""
        return Line(self.desk, self._noise, checked=checked)

    # -- what the fingers meet: drivers.sim.devices.jaws.Surroundings -------------------------------------

    def closing(self) -> float | None:
        """Squeezes what lies between the jaws at the arm's true pose, if the hand is low enough.

        Returns:
            Width at which something will stop the jaws, mm; None: nothing will.
        """
        hand, height_mm = self._hand()
        if hand is None or height_mm > self.table.geometry.closing_mm or self._risen:
            return None
        return self.table.squeeze(hand)

    def gripped(self) -> None:
        """Completes the squeeze: the jaws have stopped at the part, which lies at its final pose now."""
        self.table.gripped()

    def released(self) -> None:
        """Releases the part: it stays or, if it was lifted, falls."""
        self._let_go = True
        self.table.released()

    # -- the arm ----------------------------------------------------------------------------------

    def arm_stands(self) -> None:
        """Applies the effects of the arm's last motion to the part; does nothing if there is no new motion.

        It is called when an arm instruction may be over. In the motion the hand may have carried the part,
        pushed it, or come down on it.
        """
        if self.arm.moves == self._moves:
            return
        self._moves = self.arm.moves
        now_s = self.now()
        opening_mm = self.gripper.opening_mm(now_s)  # first lets the jaws act until now
        hand, height_mm = self._hand()
        if height_mm < self._height_mm:
            self._let_go = False
        if height_mm != self._height_mm:
            self._risen = self._let_go
        self._height_mm = height_mm
        low = height_mm <= self.table.geometry.reach_mm
        was_low, self._low = self._low, low
        if hand is None:
            return
        if not self.table.carried(hand, lifted=not low):
            self.gripper.lose_object(now_s)
        if low and was_low:
            self.table.pushed(self._stood, hand, opening_mm)
        elif low:
            self.table.placed(hand, opening_mm)
        self._stood = hand

    def _hand(self) -> tuple[Pose2 | None, float]:
        """Pose at which the fingers meet (None if the hand does not point down), and hand height, mm."""
        x, y, z, rotation = self.arm.pose_at(self.now())
        try:
            return compose((x, y, hand_angle(rotation)), self._middle), z
        except ProtocolError:
            return None, z

    # -- feeder and ground truth ------------------------------------------------------------------

    def answer(self, what: str) -> Mapping[str, object] | None:
        """Answers a request for the next part, or for the truth about the part; None for other requests."""
        self.gripper.advance(self.now())
        if what == "next_part":
            return {"part": self.table.next_part()}
        return self.table.truth()._asdict() if what == "truth" else None

    def look(self) -> Look:
        """What a camera under the table has in view now."""
        self.gripper.advance(self.now())
        return self.table.look()
