"""Contract of arms (`drivers.ports`): tests against an arm, simulated or real, in a rig."""

import math
import random
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Protocol

import pytest

from drivers import ports
from drivers.errors import ArmError, ReadOnlyError
from drivers.ports import Arm, PoseOfHand


class ArmRig(Protocol):
    """Test rig that the author of a driver supplies; it starts an arm at (0, 0, 100) mm, hand down, 0 rad."""

    far_mm: float  # x of an unreachable place; all places up to 100 mm from 0 in x and y must be reachable

    @property
    def moves(self) -> int:
        """Number of motions of the arm so far."""

    def open(self, *, read_only: bool = False) -> AbstractContextManager[Arm]:
        """Connects through the driver; leaving the context closes the connection."""

    def truth(self) -> PoseOfHand:
        """True pose of the hand."""

    def silence(self) -> None:
        """Makes the arm silent from now on."""

    def close(self) -> None:
        """Stops the rig."""


class ArmContract:
    """Tests that the driver of an arm has to pass: derive a class `Test...` and implement `make`."""

    def make(self) -> ArmRig:
        """Creates the rig of one test."""
        raise NotImplementedError

    @pytest.fixture
    def rig(self) -> Iterator[ArmRig]:
        """Creates the rig of one test, and closes it after the test."""
        result = self.make()
        yield result
        result.close()

    def test_connect_moves_nothing(self, rig: ArmRig) -> None:
        """A new connection reports where the arm stands, and moves nothing."""
        with rig.open() as arm:
            assert isinstance(arm, ports.Arm)
            assert tuple(arm.pose()) == pytest.approx((0.0, 0.0, 100.0, 0.0), abs=0.01)
        assert rig.moves == 0

    def test_arm_opened_read_only_refuses_commands(self, rig: ArmRig) -> None:
        """A read-only connection reads the pose, and refuses a motion with a ReadOnlyError."""
        with rig.open(read_only=True) as arm:
            assert tuple(arm.pose()) == pytest.approx((0.0, 0.0, 100.0, 0.0), abs=0.01)
            with pytest.raises(ReadOnlyError, match="dry run"):
                arm.move_linear((10.0, 0.0, 90.0, 0.1), 200.0)
            arm.pose()
        assert rig.moves == 0

    def test_move_ends_at_its_target(self, rig: ArmRig) -> None:
        """Each move ends within 0.001 mm of its target; `pose` is at most 0.011 mm and 0.003 rad off."""
        rng = random.Random(1)
        with rig.open() as arm:
            a = 0.0
            for _ in range(10):
                x, y, z = rng.uniform(-100, 100), rng.uniform(-100, 100), rng.uniform(5, 80)
                low, high = arm.turn_range(x, y)
                a = rng.uniform(max(low, a - 2.9), min(high, a + 2.9))
                arm.move_linear((x, y, z, a), 500.0)
                assert rig.truth()[:3] == pytest.approx((x, y, z), abs=0.001)
                seen = arm.pose()
                assert seen[:3] == pytest.approx((x, y, z), abs=0.011)
                assert math.remainder(seen[3] - a, math.tau) == pytest.approx(0.0, abs=0.003)

    def test_obstacle_on_short_motion_in_work_area_is_none(self, rig: ArmRig) -> None:
        """For a short motion within the work area, `obstacle` returns an empty string, and nothing moves."""
        with rig.open() as arm:
            assert arm.obstacle((0.0, 0.0, 60.0, 0.0), (10.0, 5.0, 60.0, 3.0)) == ""
        assert rig.moves == 0

    def test_move_is_over_when_the_call_returns(self, rig: ArmRig) -> None:
        """The arm is at rest when `move_linear` returns."""
        with rig.open() as arm:
            arm.move_linear((50.0, 0.0, 50.0, 1.0), 100.0)
            here = rig.truth()
            time.sleep(0.05)
            assert rig.truth() == here

    @pytest.mark.parametrize("bad", [math.nan, math.inf, 1e6])
    def test_move_to_unsendable_number_is_refused_and_arm_stays_usable(
        self, rig: ArmRig, bad: float
    ) -> None:
        """A target or speed that cannot be sent raises an ArmError and moves nothing; the next move works."""
        with rig.open() as arm:
            for x, z in ((bad, 50.0), (0.0, bad)):
                with pytest.raises(ArmError, match="not moved") as raised:
                    arm.move_linear((x, 0.0, z, 0.0), 100.0)
                assert raised.value.exit_code == 20
            for speed in (0.0, -5.0, math.nan):
                with pytest.raises(ArmError):
                    arm.move_linear((0.0, 0.0, 50.0, 0.0), speed)
            assert rig.moves == 0
            arm.move_linear((0.0, 0.0, 50.0, 0.0), 100.0)
            assert rig.moves == 1

    def test_move_out_of_reach_is_refused_and_arm_stays_usable(self, rig: ArmRig) -> None:
        """A move out of reach raises an ArmError that says so and moves nothing; a valid move works."""
        with rig.open() as arm:
            with pytest.raises(ArmError, match=r"not moved.*reach"):
                arm.move_linear((rig.far_mm, 0.0, 50.0, 0.0), 5000.0)
            assert rig.moves == 0
            arm.move_linear((0.0, 0.0, 50.0, 0.0), 100.0)

    def test_arm_after_silence_refuses_everything(self, rig: ArmRig) -> None:
        """After a missing answer, `pose` and `move_linear` raise an ArmError: the arm's state is unknown."""
        with rig.open() as arm:
            rig.silence()
            with pytest.raises(ArmError) as raised:
                arm.pose()
            assert raised.value.exit_code == 20
            for call in (arm.pose, lambda: arm.move_linear((0.0, 0.0, 50.0, 0.0), 100.0)):
                with pytest.raises(ArmError, match="state unknown since"):
                    call()
        assert rig.moves == 0
