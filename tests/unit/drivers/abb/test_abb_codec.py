"""The open_abb codec writes strict numbers, and reads replies that have no terminator."""

import math
import random

import pytest

from drivers.abb import codec
from drivers.abb.codec import Pose, ProtocolError
from drivers.sim.devices.rapid import Message


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e5, -2e6])
def test_number_not_finite_or_too_large_is_refused(value):
    with pytest.raises(ProtocolError):
        codec.number(value, 3)


def test_number_has_no_exponent_and_no_negative_zero():
    assert codec.number(1e-9, 3) == "0.000"
    assert codec.number(-1e-9, 3) == "0.000"
    assert codec.number(-0.0015, 3) in {"-0.001", "-0.002"}
    rng = random.Random(4)
    for _ in range(2000):
        value = rng.uniform(-1, 1) * 10 ** rng.uniform(-12, 4.9)
        text = codec.number(value, 3)
        assert set(text) <= set("-0123456789.")
        assert abs(float(text) - value) <= 0.0005001


def test_command_longest_pose_fits_and_longer_line_is_refused():
    far = Pose(-999.999, -999.999, -999.999, codec.hand_rotation(-2.5))
    assert len(codec.command(codec.MOVE_LINEAR, *codec.pose_numbers(far))) <= codec.MAX_LINE
    with pytest.raises(ProtocolError, match="too long"):
        codec.command(1, *["1"] * 11)
    with pytest.raises(ProtocolError, match="too long"):
        codec.command(1, *["12345678901"] * 7)


def test_pose_numbers_quaternion_not_of_unit_length_is_refused():
    with pytest.raises(ProtocolError, match="normalise"):
        codec.pose_numbers(Pose(0.0, 0.0, 0.0, (1.0, 0.1, 0.0, 0.0)))
    with pytest.raises(ProtocolError):
        codec.pose_numbers(Pose(0.0, 0.0, 0.0, (math.nan, 0.0, 0.0, 0.0)))


def test_command_with_pose_is_read_back_by_simulated_server():
    rng = random.Random(5)
    for _ in range(500):
        place = (rng.uniform(-400, 400) for _ in range(3))
        pose = Pose(*place, codec.hand_rotation(rng.uniform(-7, 7)))
        message = Message()
        message.parse(codec.command(1, *codec.pose_numbers(pose)).decode())
        assert (message.code, message.count) == (1, 7)
        assert message.parameters[:3] == pytest.approx(list(pose[:3]), abs=0.00055)
        assert message.parameters[3:7] == pytest.approx(list(pose.rotation), abs=2e-7)


def test_hand_angle_of_hand_rotation_is_angle_within_half_a_turn():
    for step in range(-40, 41):
        angle = step * 0.2
        back = codec.hand_angle(codec.hand_rotation(angle))
        assert -math.pi <= back <= math.pi
        assert math.remainder(back - angle, math.tau) == pytest.approx(0.0, abs=1e-12)
        w, x, y, z = codec.hand_rotation(angle)
        assert codec.hand_angle((-w, -x, -y, -z)) == pytest.approx(back)


def test_parse_reply_prefix_is_none_until_last_field_begins():
    text = "3 1 10.00 -20.50 30.00 0.000 1.000 0.000 0.000"
    last = text.rindex(" ") + 1
    for end in range(len(text) + 1):
        reply = codec.parse_reply(text[:end], 3)
        assert (reply is not None) == (end > last)
    seen = codec.parse_numbers(codec.parse_reply(text, 3))
    assert seen == (10.0, -20.5, 30.0, 0.0, 1.0, 0.0, 0.0)


@pytest.mark.parametrize("text", ["2 1 ", "1 2 ", "1 1 x", "31 1 ", "hello", "1 1  ", "-1 1 "])
def test_parse_reply_that_does_not_fit_is_refused(text):
    with pytest.raises(ProtocolError):
        codec.parse_reply(text, 1)


def test_parse_reply_with_too_many_fields_is_refused():
    with pytest.raises(ProtocolError, match="more than"):
        codec.parse_reply("3 1 1 2 3 4 5 6 7 8", 3)


def test_hand_angle_of_hand_not_pointing_down_is_refused():
    with pytest.raises(ProtocolError, match="point down"):
        codec.hand_angle((1.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(("field", "problem"), [("x", "garbled"), ("nan", "finite")])
def test_parse_numbers_field_not_finite_number_is_refused(field, problem):
    with pytest.raises(ProtocolError, match=problem):
        codec.parse_numbers(codec.Reply(3, True, ("1", "2", field, "0", "1", "0", "0")))


def test_drop_stale_removes_only_complete_acknowledgements():
    assert codec.drop_stale("1 1 0 1 ", 0) == "0 1 "
    assert codec.drop_stale("1 1 33 0 0 1 ", 0) == "0 1 "
    assert codec.drop_stale("0 1 ", 0) == "0 1 "
    assert codec.drop_stale("1 1", 0) == "1 1"
    assert codec.drop_stale("3 1 1 2 3 4 5 6 7", 0) == "3 1 1 2 3 4 5 6 7"


@pytest.mark.parametrize(
    ("text", "code", "ended"),
    [
        ("3 1 1.00 2.00 3.00 0.000 1.000 0.000 0.012", 3, True),
        ("3 1 1.00 2.00 3.00 0.000 1.000 0.000 0.01", 3, False),
        ("3 1 1.00 2.00 3.00 0.000 1.000 0.000 -0", 3, False),
        ("4 1 1.00 2.00 3.00 4.00 5.00 -61.25", 4, True),
        ("4 1 1.00 2.00 3.00 4.00 5.00 -61.2", 4, False),
        ("1 1 ", 1, True),
    ],
)
def test_reply_ended_only_where_no_digit_can_follow(text, code, ended):
    reply = codec.parse_reply(text, code)
    assert reply is not None
    assert reply.ended == ended
