"""The checks of `grasp-doctor` on the open ports of a UR controller."""

import re
import socket

import pytest

from runtime.commands.checks import Verdict
from runtime.commands.ur_checks import accepts, check_controllers

E_SERIES = {29999, 30002, 30004, 63352}


def looked(addresses, ports):
    listens = lambda host, port: host == "ur" and port in ports  # noqa: E731
    return list(check_controllers(iter(addresses), listens))


@pytest.mark.parametrize("ports", [{30002, 30004, 63352}, E_SERIES])
def test_check_controllers_of_sound_cell_are_all_good(ports):
    result = looked(["urcap://ur", "ur://ur?tool=0,0,150"], ports)
    assert [finding.verdict for finding in result] == [Verdict.GOOD] * 2


@pytest.mark.parametrize(
    ("addresses", "ports", "sentence", "remedy"),
    [
        (["urcap://ur"], set(), "Nothing listens on ur", "address, cable and power"),
        (["urcap://ur"], E_SERIES - {63352}, "port 63352 of ur, where Rob", "Install the URCap"),
        (["urcap://ur"], {30002, 30004}, "as on PolyScope X", r"forwarder.*rtu\+tcp://ur:54321"),
        (["urcap://ur"], {30004, 54321}, "port 63352", r"use --port rtu\+tcp://ur:54321"),
        (["rtu+tcp://ur:54321"], {30004}, "does not forward", "forwarder's URCap"),
        (["ur://ur"], {29999}, "Port 30004 of ur is closed", "Enable RTDE"),
        (["ur://ur"], {30004}, "Port 30002 of ur is closed", "secondary interface"),
    ],
)
def test_check_controllers_closed_port_names_cause_and_remedy(addresses, ports, sentence, remedy):
    results = [finding for finding in looked(addresses, ports) if finding.verdict is Verdict.BAD]
    assert len(results) >= 1
    assert sentence in results[0].sentence or sentence in results[-1].sentence
    assert any(re.search(remedy, finding.remedy) for finding in results)


@pytest.mark.parametrize("address", ["ur://ur:99999", "urcap://ur:x", "tcp://ur:99999"])
def test_check_controllers_invalid_port_is_left_to_driver(address):
    assert looked([address], E_SERIES) == []


def test_check_controllers_warns_of_two_urcaps_for_one_gripper():
    *_, last = looked(["urcap://ur"], E_SERIES | {54321})
    assert (last.verdict, "two URCaps" in last.sentence) == (Verdict.WARNING, True)


def test_accepts_sends_nothing():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert accepts("127.0.0.1", port)
        client, _ = server.accept()
        assert client.recv(10) == b""
        client.close()
    assert not accepts("127.0.0.1", port)
    assert not accepts("no such host.", port)
