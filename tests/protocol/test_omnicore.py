"""The OmniCore driver and its simulated controller: sign-in, refusals, stops, the RAPID module."""

import contextlib
import http.client
import math
import re
import socket
import ssl
import threading
import time
from pathlib import Path

import pytest
from arm_rigs import OmniCoreRig, certificate
from impostor import Impostor

import drivers.abb
from drivers import connect
from drivers.abb import rws
from drivers.abb.codec import IDENTITY
from drivers.clock import Clock, Pace
from drivers.errors import ArmError

TARGET = (40.0, -30.0, 60.0, 0.5)
RAPID = Path(drivers.abb.__file__).with_name("SqueezeTree.modx").read_text(encoding="ascii")


@pytest.fixture
def rig():
    with contextlib.closing(OmniCoreRig(digest=True)) as result:
        yield result


@pytest.fixture
def basic():
    with contextlib.closing(OmniCoreRig()) as result:
        yield result


def test_move_linear_first_starts_program_and_next_continues_it(rig):
    with rig.open() as arm:
        arm.pose()
        assert not rig.model.running
        arm.move_linear(TARGET, 200.0)
        assert rig.model.pointer == ("SqueezeTree", "SqueezeTreeMain")
        assert rig.truth() == pytest.approx(TARGET, abs=1e-3)
        arm.move_linear((0.0, 0.0, 60.0, 0.0), 200.0)
    assert rig.moves == 2
    with rig.open() as arm:  # the program still waits for requests
        arm.move_linear(TARGET, 200.0)
    assert (rig.moves, rig.model.running, rig.model.master) == (3, True, False)


def test_move_linear_request_left_over_is_not_executed(basic):
    basic.model.symbols |= {"sq_request": "17", "sq_target": "[[300,0,300],[0,1,0,0]]"}
    with basic.open() as arm:
        arm.move_linear(TARGET, 200.0)
    assert basic.moves == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mode": "MANR"}, "in mode MANR; switch it to automatic"),
        ({"motors": "emergencystop"}, "in state emergencystop"),
        ({"running": True}, "module Module1 runs on the controller; stop it first"),
    ],
)
def test_move_linear_controller_not_ready_is_refused_and_pose_works(basic, change, message):
    with basic.open() as arm:
        here = arm.pose()
        for name, value in change.items():
            setattr(basic.model, name, value)
        with pytest.raises(ArmError, match=f"not moved: .*{message}"):
            arm.move_linear(TARGET, 200.0)
        assert arm.pose() == here
    assert basic.moves == 0


def test_move_linear_program_stopped_on_way_makes_state_unknown(basic):
    with basic.open() as arm:
        wait = arm._await

        def stopped(name, *rest):
            if name == "sq_done":
                basic.model.stop(basic.now())
            wait(name, *rest)

        arm._await = stopped
        with pytest.raises(ArmError, match="stopped on the way; see the event log"):
            arm.move_linear(TARGET, 5.0)
        with pytest.raises(ArmError, match="state unknown since"):
            arm.pose()


@pytest.mark.parametrize("when", ["sq_started", "sq_done"])
def test_move_linear_interrupted_stops_arm(basic, when):
    with basic.open() as arm:
        wait = arm._await

        def interrupted(name, *rest):
            if name == when:
                raise KeyboardInterrupt
            wait(name, *rest)

        arm._await = interrupted
        with pytest.raises(KeyboardInterrupt):
            arm.move_linear(TARGET, 2.0)
        assert not basic.model.running
        here = basic.truth()
        time.sleep(0.05)
        assert basic.truth() == here
        assert math.dist(here[:3], TARGET[:3]) > 1.0
        with pytest.raises(ArmError, match="interrupted"):
            arm.pose()


def test_move_linear_slowed_by_controller_limit_ends_at_deadline(basic):
    basic.model.symbols["sq_fastest"] = "0.5"
    with basic.open() as arm:
        arm.pose()
        with pytest.raises(ArmError, match="not there after"):
            arm.move_linear(TARGET, 1000.0)
    assert not basic.model.running


def test_arm_frames_are_applied_by_controller(basic):
    tool, table = IDENTITY._replace(z_mm=150.0), IDENTITY._replace(x_mm=10.0, y_mm=20.0, z_mm=5.0)
    with basic.open(tool=tool, work_object=table) as arm:
        arm.move_linear((0.0, 0.0, 100.0, 0.3), 400.0)
        assert arm.pose() == pytest.approx((0.0, 0.0, 100.0, 0.3), abs=1e-4)
    assert basic.truth()[:3] == pytest.approx((10.0, 20.0, 255.0), abs=1e-3)


def test_connect_wrong_password_is_reported_and_not_printed(rig, monkeypatch):
    monkeypatch.setenv(rws.PASSWORD, "hunter2")
    with pytest.raises(ArmError, match="refuses the user 'Default User'; set SQUEEZE") as raised:
        rig.open()
    assert "hunter2" not in str(raised.value)


def test_connect_named_certificate_is_checked(basic, monkeypatch, tmp_path):
    monkeypatch.setenv(rws.CERTIFICATE, certificate())
    with basic.open() as arm:
        arm.pose()
    other = OmniCoreRig.__init__.__globals__["certificate"].__wrapped__()
    monkeypatch.setenv(rws.CERTIFICATE, other)
    with pytest.raises(ArmError, match="certificate"):
        basic.open()
    monkeypatch.setenv(rws.CERTIFICATE, str(tmp_path / "none.pem"))
    with pytest.raises(ArmError, match=r"none\.pem cannot be read"):
        basic.open()


@pytest.mark.parametrize("stated", [None, "ab" * 32, "0" * 64])
def test_connect_unstated_certificate_is_refused_before_any_request(basic, monkeypatch, stated):
    if stated is None:
        monkeypatch.delenv(rws.CERTIFICATE)
    else:
        monkeypatch.setenv(rws.CERTIFICATE, stated)
    asked = []
    monkeypatch.setattr(http.client.HTTPSConnection, "request", lambda *_: asked.append(1))
    with pytest.raises(ArmError, match="no password was sent") as raised:
        basic.open()
    assert asked == []
    monkeypatch.undo()
    shown = re.search(r"SHA-256: ([0-9a-f]{64})", str(raised.value))[1]
    for words in (shown, ":".join(re.findall("..", shown.upper())), rws.ANY):
        monkeypatch.setenv(rws.CERTIFICATE, words)
        with basic.open() as arm:
            arm.pose()


def test_connect_rapid_module_missing_or_of_other_version_is_refused(basic):
    del basic.model.symbols["sq_version"]
    with pytest.raises(ArmError, match=r"404: no such resource.*load SqueezeTree.modx into T_ROB1"):
        basic.open()
    basic.model.symbols["sq_version"] = "2"
    with pytest.raises(ArmError, match="of version 2; load version 1"):
        basic.open()


@pytest.mark.parametrize("bytes_sent", [b"", b"220 ftp ready\r\n", b"HTTP/1.1 200 OK\r\n\r\n"])
def test_connect_arm_server_other_than_omnicore_is_refused(bytes_sent, monkeypatch):
    monkeypatch.setattr(rws, "ANSWER_S", 0.3)
    says = pytest.raises(ArmError, match="no answer to GET")
    with contextlib.closing(Impostor(greeting=bytes_sent)) as impostor, says:
        connect.arm(f"omnicore://{impostor.address}")


@pytest.mark.parametrize("body", ["", "[]", "{}", '{"state": []}', '{"state": [1]}', "<html>"])
def test_states_malformed_body_raises_rws_error(body):
    with pytest.raises(rws.RwsError, match="not understood"):
        rws._states("/x", body)


def test_rws_answer_after_timeout_is_not_taken_for_later_one(basic, monkeypatch):
    session = rws.Rws("127.0.0.1", basic.server.port, Pace(Clock()))
    assert session.state("/rw/panel/opmode")[0]["opmode"] == "AUTO"
    first, basic.server.silent = basic.server.silent, lambda: time.sleep(0.5)
    with monkeypatch.context() as impatient:
        impatient.setattr(rws, "ANSWER_S", 0.2)
        with pytest.raises(rws.RwsError, match="no answer to GET"):
            session.state("/rw/panel/opmode")
    basic.server.silent = first
    assert session.state("/rw/panel/ctrl-state")[0]["ctrlstate"] == "motoron"
    session.close()


def test_rapid_module_declares_symbols_of_simulator(basic):
    declared = dict(re.findall(r"^    (?:PERS|CONST) (\w+ sq_\w+):=(.*);$", RAPID, re.MULTILINE))
    kinds = {name: kind for kind, name in (words.split() for words in declared)}
    values = {words.split()[1]: value for words, value in declared.items()}
    assert set(basic.model.symbols) <= set(kinds)
    for name, value in basic.model.symbols.items():
        assert kinds[name] == ("pose" if value.startswith("[") else "num")
        assert values[name].replace(" ", "") == value
    assert RAPID.count("PROC SqueezeTreeMain()") == RAPID.count("ENDPROC") == 1


def test_rapid_module_drops_old_requests_and_reports_in_order():
    body = RAPID.partition("PROC SqueezeTreeMain()")[2].partition("ENDPROC")[0]
    before, loop = body.split("WHILE TRUE DO")
    assert {"sq_started:=sq_request;", "sq_done:=sq_request;"} <= set(before.split())
    assert "Move" not in before
    words = ("WaitUntil", "sq_target.trans", "sq_fastest", "sq_started:=", "MoveL", "sq_done:=")
    order = [loop.index(word) for word in words]
    assert order == sorted(order)
    assert ",fine," in loop


class Talker:
    """A TLS server that answers a request with the pieces of a generator, as fast as the client reads."""

    def __init__(self, pieces, pause_s=0.0):
        self._pieces, self._pause_s = pieces, pause_s
        self._context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self._context.load_cert_chain(certificate())
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.sent = 0
        self._closed = threading.Event()
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self):
        self._closed.set()
        self._listener.close()

    def _serve(self):
        while not self._closed.is_set():
            with contextlib.suppress(OSError):  # a client that only checks whether the port is open
                self._talk(self._context.wrap_socket(self._listener.accept()[0], server_side=True))

    def _talk(self, client):
        with client:
            client.recv(4096)
            for piece in self._pieces():
                client.sendall(piece)
                self.sent += len(piece)
                if self._closed.wait(self._pause_s):
                    return


def endless(start, piece):
    yield start
    while True:
        yield piece


HEAD = b"HTTP/1.1 200 OK\r\n"
CHUNKED, CHUNK = b"Transfer-Encoding: chunked\r\n\r\n", b"8000\r\n" + b"x" * 0x8000 + b"\r\n"
LONG = b"Content-Length: 99999999999\r\n\r\n"
ENDLESS = {
    "a body without a length": lambda: endless(HEAD + b"\r\n", b"x" * 65536),
    "a body of any length": lambda: endless(HEAD + LONG, b"x" * 65536),
    "chunks": lambda: endless(HEAD + CHUNKED, CHUNK),
    "a chunk": lambda: endless(HEAD + CHUNKED + b"fffffffffff\r\n", b"x" * 65536),
    "headers": lambda: endless(HEAD, b"X-A: b\r\n" * 1000),
    "a header": lambda: endless(HEAD + b"X-A: ", b"x" * 65536),
    "promises to go on": lambda: endless(b"", b"HTTP/1.1 100 Continue\r\n\r\n" * 100),
}


@pytest.mark.parametrize("name", ENDLESS)
def test_connect_arm_endless_answer_is_refused_early(name, monkeypatch):
    monkeypatch.setenv(rws.CERTIFICATE, "any")
    with contextlib.closing(Talker(ENDLESS[name])) as talker:
        with pytest.raises(ArmError, match=r"longer than 1048576 bytes|no answer to GET") as raised:
            connect.arm(f"omnicore://127.0.0.1:{talker.port}")
        assert talker.sent < 16 << 20
    assert len(str(raised.value)) < 400


DRIPS = {
    "a body": lambda: endless(HEAD + b"Content-Length: 1000\r\n\r\n", b"x"),
    "headers": lambda: endless(HEAD, b"X"),
}


@pytest.mark.parametrize("name", DRIPS)
def test_connect_arm_dripping_answer_ends_at_deadline(name, monkeypatch):
    """Each piece comes in time, but the whole answer would take more than a minute."""
    monkeypatch.setenv(rws.CERTIFICATE, "any")
    monkeypatch.setattr(rws, "ANSWER_S", 0.5)
    with contextlib.closing(Talker(DRIPS[name], 0.1)) as talker:
        with pytest.raises(ArmError, match=r"no answer to GET .*timed out"):
            connect.arm(f"omnicore://127.0.0.1:{talker.port}")
        assert talker.sent < 100


def test_move_linear_long_text_of_controller_is_shortened(basic):
    basic.model.mode = "MANR\r\n" + "\x1b[31m" * 1000
    with basic.open() as arm, pytest.raises(ArmError, match=r"in mode MANR") as raised:
        arm.move_linear(TARGET, 200.0)
    assert len(str(raised.value)) < 300
    assert str(raised.value).isprintable()
