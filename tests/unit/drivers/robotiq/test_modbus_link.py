"""The Modbus link on a virtual clock: late, foreign and damaged answers, noisy lines, lost ports."""

import random
import struct

import pytest
from lines import Line
from rtu_frames import rtu_frame

from drivers import connect
from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import LinkError, LinkTimeout, PortError
from drivers.links import DRAIN_S
from drivers.modbus.framing import TcpFraming
from drivers.modbus.master import GAP_S
from drivers.ports import no_report
from drivers.robotiq.modbus import TCP, ModbusLink, read_request, wiring_of

STATUS = bytes.fromhex("B900 00FF BD00")


def answer(count=3, status=STATUS):
    block = (status + bytes(10))[: 2 * count]
    return rtu_frame(f"09 03 {2 * count:02X} {block.hex()}")


def link(*script, report=None):
    line = Line(*script)
    lines = []
    channel = ModbusLink(line, Pace(line.clock), lambda kind, fields: lines.append((kind, fields)))
    return channel, line, lines


def test_modbus_link_read_answer_in_pieces_is_joined():
    whole = answer()
    channel, line, incidents = link([(0.001 * k, whole[k : k + 1]) for k in range(len(whole))])
    assert channel.read() == STATUS
    assert line.sent[0][1] == bytes.fromhex("090307D00003040E")
    assert (len(line.sent), incidents) == (1, [])


@pytest.mark.parametrize(
    "before",
    [
        bytes.fromhex("090307D00003040E"),  # an echo of the request
        b"\x00",
        b"\xff\x09\x03",
        b"\x09\x03\x06",
        rtu_frame("08 03 06 0000 0000 0000"),  # another slave's answer
        answer(4),  # an answer to another question
        answer()[:-1] + b"\0",  # a damaged one
        rtu_frame("09 04 06 B900 00FF BD00"),  # another function's answer, as long
        rtu_frame("09 10 03E8 0003"),  # the acknowledgement of a write
        rtu_frame("09 84 02"),  # the refusal of another function
    ],
)
def test_modbus_link_read_bytes_before_answer_are_skipped(before):
    channel, _, _ = link([(0.001, before + answer())])
    assert channel.read() == STATUS


def test_modbus_link_read_random_noise_times_out():
    rng = random.Random(2)
    channel, _, _ = link(*([(0.001, rng.randbytes(rng.randrange(1, 60)))] for _ in range(600)))
    for _ in range(200):
        with pytest.raises(LinkTimeout):
            channel.read()


def test_modbus_link_read_silence_is_reported_and_tried_three_times():
    channel, line, incidents = link()
    with pytest.raises(LinkTimeout, match="did not answer within"):
        channel.read()
    assert len(line.sent) == 3
    assert [fields["incident"] for _, fields in incidents] == [
        *("no answer", "read repeated", "no answer", "read repeated", "no answer")
    ]
    assert line.clock.now() < 3 * (LINK_TIMEOUT_S + 0.05)


@pytest.mark.parametrize("late_s", [0.51, 0.6, 0.9, 1.2, 1.4])
def test_modbus_link_read_late_answer_is_not_taken_for_later_one(late_s):
    """An RTU answer has no number; only the count of its registers shows which request it answers."""
    old = bytes.fromhex("F900 0000 0300")
    channel, _, _ = link([(late_s, answer(3, old))], [(0.004, answer(4))], [(0.004, answer(5))])
    assert channel.read() == STATUS


class Starved(Line):
    """A line that loses 5 s in each of its first `stops` waits, as if the process were stopped."""

    stops = 1

    def receive(self, seconds):
        if self.sent and seconds > 0.1 and self.stops:
            self.stops -= 1
            self.clock.sleep(5.0)
            return b""
        return super().receive(seconds)


@pytest.mark.parametrize("stops", [1, 2])
def test_modbus_link_read_process_stopped_meanwhile_is_repeated(stops):
    old, new = [(0.004, answer(3, bytes(6)))], [(0.004, answer())]
    line = Starved(*stops * [old], new)
    line.stops = stops
    lines = []
    channel = ModbusLink(
        line, Pace(line.clock), lambda kind, fields: lines.append(fields["incident"])
    )
    assert channel.read() == STATUS
    assert (len(line.sent), lines) == (stops + 1, stops * ["read repeated"])


def test_modbus_link_read_process_stopped_repeatedly_is_reported():
    line = Starved(*3 * [[(0.004, answer())]])
    line.stops = 3
    with pytest.raises(
        LinkTimeout, match=r"answered, but this process was stopped or starved .* 4\.5 s"
    ):
        ModbusLink(line, Pace(line.clock)).read()


def test_modbus_link_write_confirmed_while_process_stopped_succeeds():
    line = Starved([(0.004, rtu_frame("09 10 03E8 0003"))])
    ModbusLink(line, Pace(line.clock)).write(bytes(6))
    assert len(line.sent) == 1


def test_modbus_link_read_register_counts_stay_within_block():
    channel, line, _ = link()
    for _ in range(4):
        with pytest.raises(LinkTimeout):
            channel.read()
    counts = [int.from_bytes(data[4:6], "big") for _, data in line.sent]
    assert counts == [*range(3, 9)] * 2


def test_modbus_link_reads_keep_gap_between_them():
    channel, line, _ = link([(0.004, answer())], [(0.004, answer())])
    channel.read()
    channel.read()
    assert line.sent[1][0] - line.sent[0][0] == pytest.approx(0.004 + GAP_S)


def test_modbus_link_write_on_line_never_quiet_times_out():
    channel, line, _ = link()
    with pytest.raises(LinkTimeout):
        channel.write(bytes(6))
    began = line.clock.now()
    line.coming = [(began + 0.005 * k, b"\x55") for k in range(2000)]
    with pytest.raises(LinkTimeout):
        channel.write(bytes(6))
    assert line.clock.now() - began < DRAIN_S + LINK_TIMEOUT_S + 0.1


def test_modbus_link_broken_connection_stays_broken():
    channel, line, incidents = link([OSError(5, "gone")])
    for _ in range(2):
        with pytest.raises(LinkError, match=r"broke|closed"):
            channel.read()
    assert line.closed
    assert len(line.sent) == 1
    assert incidents[0][1]["incident"] == "connection broke"


def test_modbus_link_read_exception_answer_is_refusal_not_timeout():
    channel, _, _ = link([(0.004, rtu_frame("09 83 02"))])
    with pytest.raises(LinkError, match="refused function 3") as raised:
        channel.read()
    assert not isinstance(raised.value, LinkTimeout)


def test_modbus_link_read_after_interrupt_ignores_earlier_answer():
    channel, line, _ = link(
        [(0.004, answer(3, bytes.fromhex("F900 0000 0300")))], [(0.004, answer())]
    )
    receive = line.receive

    def interrupt(seconds):
        if len(line.sent) == 1 and seconds > 0.1:
            line.receive = receive
            raise KeyboardInterrupt
        return receive(seconds)

    line.receive = interrupt
    with pytest.raises(KeyboardInterrupt):
        channel.read()
    assert channel.read() == STATUS


@pytest.mark.parametrize("acknowledgement", ["09 10 03E9 0003", "09 10 03E8 0002"])
def test_modbus_link_write_acknowledged_for_other_block_times_out(acknowledgement):
    channel, line, _ = link([(0.001, rtu_frame(acknowledgement))])
    with pytest.raises(LinkTimeout):
        channel.write(bytes(6))
    assert len(line.sent) == 1


# -- Modbus TCP -----------------------------------------------------------------------------------


def enveloped(number, unit, pdu):
    return struct.pack(">HHHB", number, 0, len(pdu) + 1, unit) + pdu


def mbap(number, count=3, unit=2, status=STATUS):
    return enveloped(number, unit, bytes((4, 2 * count)) + (status + bytes(10))[: 2 * count])


def tcp_link(*script):
    line = Line(*script)
    return ModbusLink(line, Pace(line.clock), no_report, TCP, TcpFraming()), line


def test_modbus_link_tcp_read_takes_answer_with_its_number():
    """The link skips stale answers, and answers of other units, that arrive before the right one."""
    wrong = mbap(1, status=bytes(6)) + mbap(7) + mbap(2, unit=3) + mbap(2, count=4)
    channel, line = tcp_link([(0.001, mbap(1))], [(0.001, wrong + mbap(2))])
    assert channel.read() == STATUS
    assert channel.read() == STATUS
    assert [int.from_bytes(data[:2], "big") for _, data in line.sent] == [1, 2]


def test_tcp_framing_number_wraps_and_is_never_zero():
    framing = TcpFraming()
    framing._number = 0xFFFE
    numbers = [int.from_bytes(framing.frame(read_request(TCP, 3))[:2], "big") for _ in range(3)]
    assert numbers == [0xFFFF, 1, 2]


def gateway(*codes):
    """A link to unit 9 behind a gateway, and the link's line.

    The gateway answers with these exception codes, then with the status.
    """
    wiring = wiring_of("tcp://h:502?unit=9&output=0x03E8&input=0x07D0&function=3", TCP)
    pdus = [bytes((0x83, code)) for code in codes] + [b"\x03\x06" + STATUS]
    line = Line(*([(0.004, enveloped(number, 9, pdu))] for number, pdu in enumerate(pdus, 1)))
    return ModbusLink(line, Pace(line.clock), no_report, wiring, TcpFraming()), line


def test_modbus_link_gateway_gets_unit_and_addresses_of_port():
    channel, line = gateway()
    assert channel.read() == STATUS
    assert line.sent[0][1] == enveloped(1, 9, bytes.fromhex("03 07D0 0003"))
    with pytest.raises(LinkTimeout):
        channel.write(bytes(6))
    assert line.sent[1][1] == enveloped(2, 9, bytes.fromhex("10 03E8 0003 06") + bytes(6))


@pytest.mark.parametrize("code", [5, 6, 11])
def test_modbus_link_gateway_briefly_refused_read_is_repeated(code):
    channel, line = gateway(code, code)
    assert channel.read() == STATUS
    assert len(line.sent) == 3


@pytest.mark.parametrize(
    ("code", "kind", "message"),
    [
        (
            2,
            LinkError,
            r"no such register \(exception 2\); check that it is a Robotiq 2F gripper, and unit",
        ),
        (5, LinkTimeout, r"takes longer \(exception 5\)"),
        (6, LinkTimeout, r"busy \(exception 6\); stop other programs"),
        (10, LinkError, r"the gateway has no way to that unit \(exception 10\)"),
        (
            11,
            LinkTimeout,
            r"the gripper behind the gateway is silent \(exception 11\); check its power",
        ),
        (99, LinkError, r"unknown reason \(exception 99\)"),
    ],
)
def test_modbus_link_gateway_refusal_has_error_and_reason(code, kind, message):
    channel, _ = gateway(code, code, code)
    with pytest.raises(LinkError, match=rf"\(unit 9\) refused function 3: .*{message}") as raised:
        channel.read()
    assert type(raised.value) is kind


@pytest.mark.parametrize(
    "query",
    [
        "unit=256",
        "unit=x",
        "unit=",
        "uint=9",
        "unit=9&unit=9",
        "function=6",
        "output=65536",
        "baud=1",
    ],
)
def test_connect_gripper_port_setting_not_understood_is_refused(query):
    key = query.partition("=")[0]
    with pytest.raises(
        PortError, match=rf"{key}=.* is not understood; there are unit \(0 to 255\)"
    ):
        connect.gripper(f"tcp://127.0.0.1:1?{query}")


def test_connect_gripper_unit_zero_is_refused_on_rtu_only():
    with pytest.raises(PortError, match=r"unit \(1 to 247\)"):
        connect.gripper("rtu+tcp://127.0.0.1:1?unit=0")
    with pytest.raises(PortError, match="nobody accepts"):
        connect.gripper("tcp://127.0.0.1:1?unit=0")
