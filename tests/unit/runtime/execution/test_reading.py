"""Checks of a reading: it must be fresh and possible, and its flag, width and current must agree."""

import itertools

import pytest
from counting import CALIBRATION, state, width_um
from refusals import refusal
from sample_tables import GRIPPER

from drivers.ports import Settled
from runtime.errors import GripperStateError
from runtime.execution.reading import (
    CLOSED_UM,
    CURRENT_MA,
    check_closed,
    check_fresh,
    check_opened,
    check_passed,
)

BAND = CURRENT_MA


def settled(count: int = 170, flag: int = 2, current: int = 300, echo: int = 255) -> Settled:
    seen = state(count, flag, echo)
    return Settled(seen.width_um, seen.object, current, seen.target_um, 0.51)


@pytest.mark.parametrize("echo", [0, 100])
def test_check_fresh_of_another_request_is_stale(echo):
    asked = f"request for {width_um(echo) / 1000:.2f} mm, requested were 0.00 mm"
    with pytest.raises(GripperStateError, match=asked):
        check_fresh(settled(echo=echo), CLOSED_UM)


@pytest.mark.parametrize(("flag", "fresh"), [(0, False), (1, True), (2, True), (3, True)])
def test_check_fresh_flag_of_continuing_motion_is_refused(flag, fresh):
    with refusal(GripperStateError, "finished and as going on", unless=fresh):
        check_fresh(settled(flag=flag), CLOSED_UM)


def test_check_closed_contradictory_count_and_flag_are_refused():
    for count, flag in itertools.product(range(256), (1, 2, 3)):
        believed = flag == 2 or (flag == 3 and width_um(count) <= GRIPPER.empty_um)
        said = "while opening" if flag == 1 else "one of the two is wrong"
        with refusal(GripperStateError, said, unless=believed):
            check_closed(settled(count, flag), CALIBRATION, BAND)


def test_check_closed_undetected_part_is_allowed_up_to_5_mm():
    """2F-85 manual, "object detection": the flag may miss a thin part, which only the width shows."""
    for width, fits in ((5_000, True), (5_001, False)):
        reading = settled(flag=3)._replace(width_um=width)
        with refusal(GripperStateError, r"nothing and stands 5\.00 mm open", unless=fits):
            check_closed(reading, CALIBRATION, BAND)


@pytest.mark.parametrize(
    ("band", "flag", "current", "believed"),
    [
        (BAND, 2, 0, True),  # the manual's own example of a held object
        (BAND, 2, 1000, True),
        (BAND, 2, 1001, False),
        (BAND, 3, 2550, False),
        (BAND, 2, -1, False),  # no motor draws a negative current
        (BAND, 3, -1, False),
        ((50, 800), 2, 40, False),
        ((50, 800), 2, 50, True),
        ((50, 800), 2, 800, True),
        ((50, 800), 2, 810, False),
        ((50, 800), 3, 0, True),  # an empty grip draws no current
    ],
)
def test_check_closed_current_outside_band_is_refused(band, flag, current, believed):
    count = 170 if flag == 2 else 229
    with refusal(GripperStateError, f"draws {current} mA at rest", unless=believed):
        check_closed(settled(count, flag, current), CALIBRATION, band)


def test_check_opened_too_little_or_stale_is_refused():
    for request in range(4, 200):
        asked = width_um(request)
        check_opened(settled(request, 3, 0, request), asked, CALIBRATION)
        check_opened(settled(request + 2, 3, 0, request), asked, CALIBRATION)
    with pytest.raises(GripperStateError, match=r"at 48\.30 mm while opening to 49\.43 mm; remove"):
        check_opened(settled(101, 1, 0, 98), width_um(98), CALIBRATION)
    with pytest.raises(GripperStateError, match="stale"):
        check_opened(settled(98, 3, 0, 97), width_um(98), CALIBRATION)
    with pytest.raises(GripperStateError, match="met something at 48"):
        check_opened(settled(101, 2, 0, 125), width_um(125), CALIBRATION)


@pytest.mark.parametrize(
    ("count", "flag", "passed"),
    [(100, 3, True), (102, 3, True), (98, 3, True), (103, 3, None), (80, 2, False), (100, 1, None)],
)
def test_check_passed_is_true_if_free_and_false_at_contact(count, flag, passed):
    reading = settled(count, flag, 0, 100)
    if passed is not None:
        assert check_passed(reading, width_um(100), CALIBRATION) is passed
        return
    wide = {100: r"48\.68", 103: r"47\.5[56]"}[count]
    record = rf"(opening|at target) at {wide} mm while closing to 48\.68 mm; the two do not fit"
    with pytest.raises(GripperStateError, match=record):
        check_passed(reading, width_um(100), CALIBRATION)
    with pytest.raises(GripperStateError, match="stale"):
        check_passed(reading, width_um(99), CALIBRATION)
