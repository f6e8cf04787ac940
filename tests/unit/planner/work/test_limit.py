"""A budget of time, and requests for an early end with the result so far."""

from planner.work.limit import Limit


def test_over_when_only_the_reserve_is_left_is_true(clock):
    limit = Limit(10.0, clock)
    clock.now += 10.0
    assert not limit.over()
    limit.reserve_s = 4.0
    assert limit.over()
    clock.now -= 5.0
    assert not limit.over()
    assert limit.over(1.5)


def test_ask_is_accepted_once_and_only_with_a_result_to_keep(clock):
    limit = Limit(10.0, clock)
    assert not limit.ask()
    assert not limit.asked
    limit.standing = True
    assert limit.ask()
    assert not limit.ask()
