"""The text socket of the URCap on a virtual clock: answers in pieces, late, foreign or missing."""

import random

import pytest
from lines import Line

from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import LinkError, LinkTimeout
from drivers.ports import no_report
from drivers.robotiq.registers import OUTPUT_FIELDS, decode, pack
from drivers.robotiq.urcap import READ, UrcapLink
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.devices.gripper_urcap import Urcap

VALUES = {"ACT": 1, "GTO": 1, "STA": 3, "FLT": 0, "PRE": 255, "OBJ": 2, "POS": 147}
GO = pack(OUTPUT_FIELDS, {"rACT": 1, "rGTO": 1, "rPR": 255, "rSP": 9, "rFR": 7})


def output(end=b"", **changed):
    """The socket's answers to the queries of one `read` of the link, as a script for `Line`.

    `changed` replaces the values of some variables; each answer ends with `end`.
    """
    values = VALUES | changed
    return [[(0.004, b"%s %d%s" % (name.encode(), values[name], end))] for name in READ]


def items(script, report=no_report):
    line = Line(*script)
    return line, UrcapLink(line, Pace(line.clock), report)


def asked(line):
    return [data.decode().strip() for _, data in line.sent]


@pytest.mark.parametrize("end", [b"", b"\n", b"\r\n", b" "])
def test_urcap_link_read_asks_for_each_variable_once(end):
    line, link = items(output(end))
    seen = decode(link.read())
    assert asked(line) == [f"GET {name}" for name in READ]
    assert (seen.activated, seen.going, seen.object_flag) == (True, True, 2)
    assert (seen.echo_counts, seen.position_counts, seen.fault) == (255, 147, 0)


def test_urcap_link_read_number_in_pieces_is_joined():
    script = output()
    script[-1] = [(0.004, b"PO"), (0.005, b"S 1"), (0.006, b"4"), (0.007, b"7")]
    _, link = items(script)
    assert decode(link.read()).position_counts == 147


def test_urcap_link_read_fault_is_low_nibble():
    _, link = items(output(FLT=0x95))
    assert decode(link.read()).fault == 0x05


@pytest.mark.parametrize(
    ("before", "block", "sent"),
    [
        ({}, GO, "SET SPE 9 FOR 7 POS 255 GTO 1"),
        ({}, pack(OUTPUT_FIELDS, {"rACT": 1, "rPR": 20}), "SET GTO 0"),
        ({"ACT": 0}, pack(OUTPUT_FIELDS, {"rACT": 1}), "SET GTO 0 ACT 1"),
        ({}, bytes(6), "SET GTO 0 ACT 0"),
    ],
)
def test_urcap_link_write_sets_act_only_to_change_it(before, block, sent):
    line, link = items([*output(**before), [(0.004, b"ack")]])
    link.read()
    link.write(block)
    assert asked(line)[-1] == sent


def test_urcap_link_read_after_late_answer_ignores_it():
    """The acknowledgement comes after the deadline, together with outdated counts."""
    late = LINK_TIMEOUT_S + 0.01
    script = [[(late, b"ack"), (late + 0.005, b"POS 3")], [(0.02, b"SPE 255")], *output()]
    reports = []
    line, link = items(script, lambda kind, fields: reports.append(fields["incident"]))
    with pytest.raises(LinkTimeout, match="did not answer 'SET"):
        link.write(GO)
    assert decode(link.read()).position_counts == 147
    assert asked(line)[1:] == ["GET SPE", *(f"GET {name}" for name in READ)]
    assert reports == ["no answer"]


def test_urcap_link_read_silence_times_out_and_closes_link():
    line, link = items([])
    with pytest.raises(LinkTimeout):
        link.read()
    assert asked(line) == ["GET ACT", "GET SPE", "GET FOR"]
    with pytest.raises(LinkError, match="closed: the URCap fell silent"):
        link.read()
    assert len(line.sent) == 3


ANSWERS = [b"?", b"nack", b"POS 147", b"ACT 256", b"ACT one", b"ACT 1111", b"\xff"]


@pytest.mark.parametrize("answer", [*ANSWERS, b"HTTP/1.1 400 Bad Request"])
def test_urcap_link_read_other_answer_is_refused(answer):
    _, link = items([[(0.004, answer)]])
    with pytest.raises(LinkError, match=r"check that it is Robotiq's URCap|no register value"):
        link.read()


def test_urcap_link_read_line_never_quiet_raises_link_error():
    line, link = items(output())
    line.receive = lambda seconds: line.clock.sleep(0.001) or b"POS 3\n"
    with pytest.raises(LinkError):
        link.read()
    assert line.clock.now() < 200.0


def test_urcap_link_read_process_suspended_times_out():
    line, link = items([[(0.004, b"ACT 1")]] * 6)
    receive = line.receive

    def suspended(seconds):
        line.clock.advance(line.clock.now() + 3.0)
        return receive(seconds)

    line.receive = suspended
    with pytest.raises(LinkTimeout):
        link.read()


def test_urcap_link_read_noise_raises_link_error():
    rng = random.Random(5)
    for _ in range(60):
        script = output()
        script[rng.randrange(len(script))] = [(0.004, rng.randbytes(rng.randrange(1, 12)))]
        _, link = items(script)
        with pytest.raises(LinkError):
            link.read()


NO_LINES = [b"", b"GET", b"GET XYZ", b"GET POS 1", b"SET", b"SET POS", b"SET POS -1"]
NO_LINES += [b"SET POS 256", b"SET GTO 2", b"set POS 1", b"SET POS 1 XYZ 2", b"SET STA 3"]


@pytest.mark.parametrize("line", [*NO_LINES, b"\xff\xfe", b"SET POS \xb2"])
def test_urcap_malformed_line_is_not_obeyed(line):
    device = GripperModel(random.Random(1))
    assert Urcap(device, lambda: 1.0).answer(line) == b"?"
    assert device.read_output() == bytes(16)
