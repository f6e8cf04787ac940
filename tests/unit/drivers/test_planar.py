"""Poses in the plane form a group, and their angles stay within half a turn."""

import math

from hypothesis import given
from hypothesis import strategies as st

from drivers.planar import compose, relative

POSES = st.tuples(st.floats(-300, 300), st.floats(-300, 300), st.floats(-3.1, 3.1))


@given(POSES, POSES)
def test_relative_undoes_compose(a, b):
    x, y, theta = relative(a, compose(a, b))
    assert max(abs(x - b[0]), abs(y - b[1])) < 1e-9
    assert abs(math.remainder(theta - b[2], math.tau)) < 1e-9
    assert max(map(abs, relative(a, a))) < 1e-9


@given(POSES, POSES)
def test_compose_and_relative_keep_angle_within_half_a_turn(a, b):
    assert max(abs(compose(a, b)[2]), abs(relative(a, b)[2])) <= math.pi
