"""The simulated open_abb server towards any client, including the traps of SERVER.mod.

Some tests use the model, where no time passes; the others use plain TCP and no code of the driver.
"""

import contextlib
import math
import random
import select
import socket
import time

import pytest

from drivers.abb.codec import Pose
from drivers.sim.devices import rapid
from drivers.sim.devices.arm import HAND_DOWN, ArmModel
from drivers.sim.devices.arm_server import ArmServer
from drivers.sim.wire.serving import Site

SCALE = 50.0
BASE = Pose(-300.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0))


@pytest.fixture
def arm():
    return ArmModel(BASE)


def ask(arm, text, now=0.0):
    return arm.execute(text, now).text


def pose(arm, now=1e9):
    return [float(field) for field in ask(arm, "3 #", now).split()[2:]]


# -- the parser -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "reply"),
    [
        ("0 #", "0 1 "),
        ("00 #", "0 1 "),
        ("03 #", "3 1 0.00 0.00 100.00 0.000 1.000 0.000 0.000"),
        ("0 1 #", "0 0 "),  # ping takes no parameters
        ("8 100 50 #", "8 1 "),
        ("8 100 50 0 0 #", "8 1 "),
        ("8 100 50 0 #", "8 0 "),  # neither two nor four
        ("8 100 50#", "8 0 "),  # no space before #: the last parameter is lost
        ("8 +100.0 +050.5 #", "8 1 "),
        ("9 1 0 0 0 #", "9 1 "),
        ("32 #", "32 1 0.00"),
        ("97 1 #", "97 0 "),  # only the client knows it
        ("1.5 #", "2 0 "),
        ("98 #", "98 1 120-000000*ROBOTWARE_6.05.00.00*120-3/0.58"),
        ("0 #8 1 1 #", "0 1 "),  # what follows the first # is lost
        ("5 #", "5 1 0.00 0.00 0.00 0.00 0.00 0.00"),
        ("1 10 20 30 0 1 0 #", "1 0 "),  # a number too few
    ],
)
def test_arm_model_message_gets_reply_of_server_mod(arm, text, reply):
    assert ask(arm, text) == reply
    assert arm.moves == 0


@pytest.mark.parametrize("text", ["0 ", "", "#", "03#", "x #", " 0 #", "hello world"])
def test_arm_model_malformed_head_repeats_previous_code_as_bad(arm, text):
    ask(arm, "9 1 0 0 0 #")
    assert ask(arm, text) == "9 0 "


def test_arm_model_garbled_number_keeps_earlier_value(arm):
    ask(arm, "8 1000 1000 #")
    ask(arm, "1 10 20 30 0 1 0 0 #")
    ask(arm, "1 40 2O 50 0 1 0 0 #", 1000.0)  # the letter O
    assert pose(arm)[:3] == [40.0, 20.0, 50.0]


@pytest.mark.parametrize("text", ["nan", "inf", "1,5", "", "--1", "1e", "0x1"])
def test_to_value_malformed_number_is_none(text):
    assert rapid.to_value(text) is None


def test_to_value_number_with_trailing_space_is_read():
    assert rapid.to_value("1 ") == 1.0


# -- moves ----------------------------------------------------------------------------------------


def test_arm_model_move_is_acknowledged_at_end_of_path(arm):
    ask(arm, "8 50 90 #")
    ask(arm, "9 1 0 0 0 #")
    answer = arm.execute("1 100 0 100 0 1 0 0 #", 5.0)
    assert answer.ready_s == pytest.approx(5.0 + 100 / 50)
    assert arm.pose_at(6.0)[:3] == pytest.approx((50.0, 0.0, 100.0))
    assert arm.pose_at(99.0)[:3] == pytest.approx((100.0, 0.0, 100.0))


def test_arm_model_turn_takes_time_of_its_speed(arm):
    ask(arm, "8 1000 45 #")
    ask(arm, "9 1 0 0 0 #")
    half = math.radians(90) / 2
    answer = arm.execute(f"1 0 0 100 0 {math.cos(half):.5f} {math.sin(half):.5f} 0 #", 0.0)
    assert answer.ready_s == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize(
    "text",
    ["1 900 0 100 0 1 0 0 #", "2 0 0 0 0 0 999 #", "1 0 0 50 0 1.2 0 0 #", "36 0 0 50 0 1 0 0 #"],
)
def test_arm_model_unrecoverable_command_halts_without_answer(arm, text):
    answer = arm.execute(text, 0.0)
    assert answer.text is None
    assert math.isinf(answer.ready_s)
    assert arm.halted
    assert arm.moves == 0


def test_arm_model_buffer_holds_512_and_drops_rest(arm):
    for _ in range(520):
        assert ask(arm, "30 10 0 90 0 1 0 0 #") == "30 1 "
    assert ask(arm, "32 #") == "32 1 512.00"
    assert ask(arm, "31 #") == "31 1 "
    assert ask(arm, "32 #") == "32 1 0.00"


# -- the socket -----------------------------------------------------------------------------------


class Served:
    """A simulated controller at 50 times real time, and its clients."""

    def __init__(self):
        self.model = ArmModel(BASE)
        self.site = Site(SCALE)
        self.now = self.site.now
        self.server = ArmServer(self.model, self.site)
        self.clients = []

    def client(self):
        result = socket.create_connection(("127.0.0.1", self.server.port), timeout=5.0)
        result.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.clients.append(result)
        return result

    def close(self):
        for client in self.clients:
            client.close()
        self.site.close()


@pytest.fixture
def served():
    with contextlib.closing(Served()) as result:
        yield result


def talk(client, text):
    client.sendall(text.encode())
    return client.recv(256).decode()


def silent(client, seconds=0.15):
    return not select.select([client], [], [], seconds)[0]


def test_arm_server_first_answer_takes_half_a_second(served):
    before = served.now()
    client = served.client()
    assert talk(client, "0 #") == "0 1 "
    assert served.now() - before >= 0.5


def test_arm_server_command_in_two_pieces_is_two_bad_messages(served):
    client = served.client()
    assert talk(client, "0 #") == "0 1 "
    assert talk(client, "9 1 0 ") == "0 0 "
    assert talk(client, "0 0 #") == "0 0 "  # read as code 0 with one parameter


def test_arm_server_pipelined_commands_are_lost(served):
    client = served.client()
    assert talk(client, "0 #") == "0 1 "
    assert talk(client, "0 #31 #32 #") == "0 1 "
    assert silent(client)


@pytest.fixture
def moving(served):
    """A client that has commanded a move of 20 s, which takes 0.4 s in the test."""
    client = served.client()
    talk(client, "8 5 90 #")
    client.sendall(b"1 100 0 100 0 1 0 0 #")
    assert silent(client, 0.04)
    return client


def test_arm_server_during_move_answers_nothing(moving):
    moving.sendall(b"0 #")
    assert moving.recv(4) == b"1 1 "
    assert moving.recv(4) == b"0 1 "


def test_arm_server_unreachable_target_stays_connected_and_silent(served):
    client = served.client()
    client.sendall(b"1 2000 0 100 0 1 0 0 #")
    assert silent(client)
    client.sendall(b"0 #")
    assert silent(client)
    assert silent(served.client())


def test_arm_server_next_client_gets_stale_acknowledgement(served, moving):
    moving.close()
    time.sleep(0.6)
    heir = served.client()
    assert heir.recv(16) == b"1 1 "  # without a question
    assert talk(heir, "3 #").startswith("3 1 100.00 ")


def test_arm_server_serves_one_client_at_a_time(served):
    first = served.client()
    assert talk(first, "0 #") == "0 1 "
    second = served.client()
    second.sendall(b"0 #")
    assert silent(second)
    assert talk(first, "0 #") == "0 1 "
    first.close()
    with pytest.raises(ConnectionResetError):
        second.recv(16)
    assert talk(served.client(), "0 #") == "0 1 "


def test_arm_server_too_many_parameters_end_only_that_connection(served):
    client = served.client()
    client.sendall(b"1 " + b"1 " * 11 + b"#")
    assert client.recv(16) == b""
    assert talk(served.client(), "0 #") == "0 1 "


def test_arm_server_random_text_moves_nothing(served):
    rng = random.Random(6)
    client = served.client()
    assert talk(client, "0 #") == "0 1 "
    for _ in range(20):
        words = bytes(rng.choice(b"xyz,;.- ") for _ in range(rng.randrange(1, 30)))
        reply = talk(client, words.decode())
        assert reply == "0 0 "
    assert served.model.moves == 0


@pytest.mark.parametrize(("way_mm", "seconds"), [(100.0, 0.525), (8.0, 2.0 * 0.004**0.5)])
def test_arm_model_line_with_acceleration_starts_and_ends_slowly(
    way_mm: float, seconds: float
) -> None:
    arm = ArmModel(BASE, (2000.0, 700.0))
    ends_s = arm.line(Pose(0.0, 0.0, 100.0 - way_mm, HAND_DOWN), (250.0, 90.0), 0.0)
    assert ends_s == pytest.approx(seconds)
    heights = [arm.pose_at(ends_s * share).z_mm for share in (0.0, 0.01, 0.5, 0.99, 1.0)]
    assert heights[0] - heights[2] == pytest.approx(way_mm / 2)
    assert heights[0] - heights[1] == pytest.approx(1000.0 * (0.01 * ends_s) ** 2)
    assert heights[3] - heights[4] == pytest.approx(heights[0] - heights[1])
