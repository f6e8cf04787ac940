"""Fault schedules: which files are accepted, when a fault is in effect, and how it changes answers."""

import random

import pytest
from refusals import refused_in_a_line

from drivers.schunk.registers import PARAMETERS, Input
from drivers.sim.devices.jaws import Surroundings
from drivers.sim.devices.schunk import SchunkModel
from drivers.sim.faults import Channel, Desk, Fault, Listed, parse
from drivers.sim.virtual.clock import VirtualClock
from drivers.sim.wire.line import BYTE_S, Line, Outbox, Piece, UnpluggedError
from drivers.sim.wire.modbus import crc16
from runtime.shell.errors import InputError, UsageError
from runtime.table import PROFILES

REQUEST = bytes.fromhex("090307D00003040E")
BODY = bytes.fromhex("090306B90000FFBD00")
REPLY = BODY + crc16(BODY)


def line(*faults, checked=True):
    desk = Desk(Listed(faults))
    desk.begin(1)
    return Line(desk, random.Random(1), checked=checked)


def through(result, reply=REPLY):
    """The pieces of a reply that a faulty line delivers; None if the request is lost."""
    return result.carries(REQUEST, reply) if result.hears() else None


def test_parse_file_gives_faults_of_each_part(tmp_path):
    path = tmp_path / "faults.toml"
    path.write_text(
        '[[fault]]\nkind = "reply_lost"\npart = 3\nat = 40\nlength = 2\n[[fault]]\nkind="echo"\n'
    )
    schedule = parse(str(path))
    assert schedule.of_part(3) == (Fault("reply_lost", 3, 40, 2), Fault("echo"))
    assert schedule.of_part(1) == (Fault("echo"),)


@pytest.mark.parametrize("text", ["seed:", "seed:x", "seed:-1", "seed:1.5"])
def test_parse_seed_not_whole_number_is_refused(text):
    with pytest.raises(UsageError, match="seed:N"):
        parse(text)


def test_parse_unreadable_file_is_refused_and_none_has_no_faults(tmp_path):
    assert parse(None).of_part(1) == ()
    with pytest.raises(InputError, match="no such file"):
        parse("no/such/faults.toml")
    with pytest.raises(InputError, match="not readable"):
        parse(str(tmp_path))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[fault", "not readable"),
        ("x = 1", r"one \[\[fault\]\]"),
        ("fault = 3", r"one \[\[fault\]\]"),
        ("fault = [3]", "the keys are"),
        ('[[fault]]\nkind = "gremlins"', "is unknown; there are"),
        ("[[fault]]\nat = 1", "is unknown"),
        ('[[fault]]\nkind = "echo"\nwhen = 1', "the keys are"),
        ('[[fault]]\nkind = "echo"\nat = -1', "whole numbers"),
        ('[[fault]]\nkind = "echo"\nlength = 0', "whole numbers"),
        ('[[fault]]\nkind = "echo"\nlength = "long"', "whole numbers"),
        ('[[fault]]\nkind = "echo"\npart = 1.5', "whole numbers"),
        ('[[fault]]\nkind = "noise"\nvalue = "much"', "value is a number"),
    ],
)
def test_parse_malformed_file_is_refused_in_a_line(tmp_path, text, says):
    path = tmp_path / "faults.toml"
    path.write_text(text)
    with refused_in_a_line(InputError, says):
        parse(str(path))


def test_desk_fault_holds_from_its_event_for_its_length():
    desk = Desk(Listed([Fault("echo", 2, at=1, length=2), Fault("noise", None, at=2)]))
    held = []
    for part in (1, 2):
        desk.begin(part)
        for _ in range(4):
            desk.next(Channel.LINE)
            held.append([fault.kind for fault in desk.holding(Channel.LINE)])
    assert held == [[], [], ["noise"], [], [], ["echo"], ["echo", "noise"], []]
    assert desk.met == ["noise", "echo", "noise"]
    assert desk.holding(Channel.ARM) == []


@pytest.mark.parametrize(
    ("fault", "pieces"),
    [
        (Fault("reply_lost"), []),
        (Fault("reply_late", value=0.7), [Piece(REPLY, 0.7)]),
        (Fault("reply_twice"), [Piece(REPLY), Piece(REPLY)]),
        (Fault("reply_truncated", value=4), [Piece(REPLY[:4])]),
        (Fault("reply_truncated", value=400), [Piece(REPLY[:-1])]),
        (
            Fault("reply_corrupted", value=9),
            [Piece(REPLY[:1] + bytes((REPLY[1] ^ 2,)) + REPLY[2:])],
        ),
        (Fault("echo"), [Piece(REQUEST), Piece(REPLY)]),
        (Fault("wrong_id", value=5), [Piece(b"\x05" + BODY[1:] + crc16(b"\x05" + BODY[1:]))]),
    ],
)
def test_line_fault_changes_answer(fault, pieces):
    assert through(line(fault)) == pieces


def test_line_noise_comes_before_answer():
    noise, reply = through(line(Fault("noise", value=7)))
    assert (len(noise.data), reply) == (7, Piece(REPLY))


def test_line_lost_request_is_not_heard():
    result = line(Fault("request_lost", at=1))
    assert through(result) == [Piece(REPLY)]
    assert through(result) is None
    assert through(result) == [Piece(REPLY)]


def test_line_without_answer_carries_at_most_echo():
    assert through(Line(), None) == []
    assert through(line(), None) == []
    assert through(line(Fault("reply_twice")), None) == []
    assert through(line(Fault("echo")), None) == [Piece(REQUEST)]


@pytest.mark.parametrize(("kind", "forbidden"), [("unplugged", False), ("permission_lost", True)])
def test_line_unplugged_raises_and_states_whether_forbidden(kind, forbidden):
    with pytest.raises(UnpluggedError) as raised:
        through(line(Fault(kind)))
    assert raised.value.forbidden == forbidden


def test_line_wrong_id_in_modbus_tcp_changes_seventh_byte():
    frame = bytes.fromhex("000100000009") + b"\x02" + BODY[1:]
    result = line(Fault("wrong_id", value=5), checked=False)
    result.hears()
    assert result.carries(b"", frame)[0].data == frame[:6] + b"\x05" + frame[7:]


def test_outbox_late_piece_does_not_delay_others():
    clock, arrived = VirtualClock(), []
    box = Outbox(BYTE_S, clock.at, lambda data: arrived.append((clock.now(), data)))
    box.put([Piece(b"late", 1.0), Piece(b"ab"), Piece(b"cd")], 10.0)
    clock.advance(20.0)
    whole_s = 10.0 + 2 * BYTE_S
    assert arrived == [
        (whole_s, b"ab"),
        (whole_s + 2 * BYTE_S, b"cd"),
        (11.0 + 4 * BYTE_S, b"late"),
    ]


@pytest.mark.parametrize(("kind", "error"), [("gflt_08", 0x6D), ("gflt_0e", 0x74)])
def test_schunk_model_scheduled_fault_is_error_of_gripper(kind, error):
    desk = Desk(Listed((Fault(kind, at=0),)))
    model = SchunkModel(random.Random(1), Surroundings(), PROFILES["schunk-egu"], desk)
    data = model.read("plc_sync_input", 0.1)
    assert Input.of(PARAMETERS["plc_sync_input"].unpack(data)).error == error
