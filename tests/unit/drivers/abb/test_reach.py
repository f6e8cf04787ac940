"""The settings in the address of an arm: each is understood as it stands, or refused before connecting."""

import math

import pytest

from drivers.abb.reach import setup_of
from drivers.errors import PortError

ARM = "tcp://127.0.0.1:5000?"


def test_setup_of_settings_are_frames_and_limits():
    setup = setup_of(
        f"{ARM}tool=0,0,150,0,1,0,0&base=1,2,3&area=-1,-2,0,1,2,3&wrist=-180,180&reach=580",
        read_only=True,
    )
    assert (setup.tool[:3], setup.base[:3]) == ((0.0, 0.0, 150.0), (1.0, 2.0, 3.0))
    assert (setup.area, setup.wrist, setup.reach_mm) == ((-1, -2, 0, 1, 2, 3), (-180, 180), 580)
    assert setup.read_only
    assert setup_of(ARM, read_only=False).reach_mm == math.inf
    rounded = setup_of(f"{ARM}work_object=0,0,0,0.7071,0,0,0.7071", read_only=False)
    assert math.hypot(*rounded.work_object.rotation) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ("base=0,0,0&area=-9,-9,0,9,9,9&area=-80,-80,0,80,80,120", "area is stated twice"),
        ("base=0,0,0&reach=10&reach=900", "reach is stated twice"),
        ("reach=10", "state base, too"),
        ("base=0,0,0&reach=-5", "reach=-5 is not understood"),
        ("base=0,0,0&reach=nan", "reach=nan is not understood"),
        ("area=9,9,9,-9,-9,0", "is not understood"),
        ("wrist=180,-180", "wrist=180,-180 is not understood"),
        ("tool=nan,0,0", "tool=nan,0,0 is not understood"),
        ("tool=0,0,150,2,0,0,0", "is not understood"),
        ("tool=0,0,150,0,0,0,0", "is not understood"),
    ],
)
def test_setup_of_limit_that_would_not_hold_is_refused(settings, says):
    with pytest.raises(PortError, match=says):
        setup_of(ARM + settings, read_only=False)
