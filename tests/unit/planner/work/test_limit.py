"""A budget of time, and a request to end with what stands."""

from planner.work.limit import Limit


def test_a_budget_ends_when_only_the_reserve_is_left(clock):
    limit = Limit(10.0, clock)
    clock.now += 10.0
    assert not limit.over()
    limit.reserve_s = 4.0
    assert limit.over()
    clock.now -= 5.0
    assert not limit.over()
    assert limit.over(1.5)


def test_a_request_is_heard_once_and_only_where_something_stands(clock):
    limit = Limit(10.0, clock)
    assert not limit.ask()
    assert not limit.asked
    limit.standing = True
    assert limit.ask()
    assert not limit.ask()
