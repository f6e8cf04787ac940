"""What every arm must do (drivers/ports.py), against each make of `arm_rigs`."""

import math
import random
import time

import pytest
from arm_rigs import BASE, RIGS

from drivers import connect, ports
from drivers.errors import ArmError, ReadOnlyError


@pytest.fixture(autouse=True)
def _other_make(monkeypatch):
    monkeypatch.setitem(connect.ARMS, "other", "other_make:arm")


@pytest.fixture(params=RIGS)
def any_arm(request):
    made = RIGS[request.param]()
    yield made
    made.close()


def test_connecting_moves_nothing(any_arm):
    with any_arm.open() as arm:
        assert isinstance(arm, ports.Arm)
        assert tuple(arm.pose()) == pytest.approx((0.0, 0.0, 100.0, 0.0), abs=0.01)
    assert any_arm.moves == 0


def test_one_opened_for_reading_cannot_be_commanded(any_arm):
    with any_arm.open(read_only=True) as arm:
        assert tuple(arm.pose()) == pytest.approx((0.0, 0.0, 100.0, 0.0), abs=0.01)
        with pytest.raises(ReadOnlyError, match="dry run"):
            arm.move_linear(10.0, 0.0, 90.0, 0.1, 200.0)
        arm.pose()
    assert any_arm.moves == 0


def test_a_move_ends_where_it_was_sent(any_arm):
    rng = random.Random(1)
    with any_arm.open() as arm:
        a = 0.0
        for _ in range(10):
            x, y, z = rng.uniform(-100, 100), rng.uniform(-100, 100), rng.uniform(5, 80)
            low, high = arm.turn_range(x, y)
            a = rng.uniform(max(low, a - 2.9), min(high, a + 2.9))
            arm.move_linear(x, y, z, a, 500.0)
            assert any_arm.truth()[:3] == pytest.approx((x, y, z), abs=0.001)
            seen = arm.pose()
            assert seen[:3] == pytest.approx((x, y, z), abs=0.011)
            assert math.remainder(seen[3] - a, math.tau) == pytest.approx(0.0, abs=0.003)


def test_nothing_is_known_against_a_short_way_in_the_middle(any_arm):
    with any_arm.open(base=BASE) as arm:
        assert arm.obstacle((0.0, 0.0, 60.0, 0.0), (10.0, 5.0, 60.0, 3.0)) == ""
    assert any_arm.moves == 0


def test_a_move_is_over_when_the_call_returns(any_arm):
    with any_arm.open() as arm:
        arm.move_linear(50.0, 0.0, 50.0, 1.0, 100.0)
        here = any_arm.truth()
        time.sleep(0.05)
        assert any_arm.truth() == here


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e6])
def test_numbers_that_cannot_be_sent_are_refused_and_the_arm_stays_usable(any_arm, bad):
    with any_arm.open() as arm:
        for target in ((bad, 0.0, 50.0, 0.0), (0.0, 0.0, bad, 0.0)):
            with pytest.raises(ArmError, match="not moved") as raised:
                arm.move_linear(*target, 100.0)
            assert raised.value.exit_code == 22
        for speed in (0.0, -5.0, math.nan):
            with pytest.raises(ArmError):
                arm.move_linear(0.0, 0.0, 50.0, 0.0, speed)
        assert any_arm.moves == 0
        arm.move_linear(0.0, 0.0, 50.0, 0.0, 100.0)
        assert any_arm.moves == 1


def test_what_is_out_of_reach_is_refused_and_the_arm_stays_usable(any_arm):
    with any_arm.open(base=BASE) as arm:
        with pytest.raises(ArmError, match=r"not moved.*reach"):
            arm.move_linear(any_arm.far_mm, 0.0, 50.0, 0.0, 5000.0)
        assert any_arm.moves == 0
        arm.move_linear(0.0, 0.0, 50.0, 0.0, 100.0)


def test_after_a_silence_everything_is_refused(any_arm):
    with any_arm.open() as arm:
        any_arm.silence()
        with pytest.raises(ArmError) as raised:
            arm.pose()
        assert raised.value.exit_code == 22
        for call in (arm.pose, lambda: arm.move_linear(0.0, 0.0, 50.0, 0.0, 100.0)):
            with pytest.raises(ArmError, match="state unknown since"):
                call()
    assert any_arm.moves == 0
