"""The lock of a device: one process at a time, under every name of the device, without files."""

import os
import subprocess
import sys

import pytest
from programs import started
from silent_names import silent_names

from drivers.abb import omnicore
from drivers.robotiq import urcap
from drivers.ur import rtde
from drivers.ur.arm import SCRIPT_PORT_BELOW
from runtime.devices import lock as locks
from runtime.devices.lock import PortLock
from runtime.shell.errors import UnreachableError

PORT = f"tcp://127.0.0.1:{10_000 + os.getpid() % 50_000}"  # locks hold for the whole machine
# Takes the lock again and again; two owners at once would collide at the file `alone`.
CONTENDER = """
import os, sys, time
from pathlib import Path
from runtime.shell.errors import UnreachableError
from runtime.devices.lock import PortLock

port, folder, held, refused = sys.argv[1], Path(sys.argv[2]), 0, 0
print("ready", flush=True)
input()
while held < 40:
    try:
        with PortLock(port):
            os.close(os.open(folder / "alone", os.O_CREAT | os.O_EXCL))
            time.sleep(0.0005)
            os.unlink(folder / "alone")
            held += 1
    except UnreachableError:
        refused += 1
print(refused)
"""


def busy(port: str) -> bool:
    try:
        PortLock(port).close()
    except UnreachableError:
        return True
    return False


def test_port_lock_of_device_under_any_name_has_one_owner(tmp_path):
    master, slave = os.openpty()
    device, link = os.ttyname(slave), tmp_path / "by-id"
    link.symlink_to(device)
    with PortLock(device):
        with pytest.raises(UnreachableError, match=f"process {os.getpid()}"):
            PortLock(str(link))
        if os.geteuid() == 0:  # a device node of another name has the same number
            os.mknod(tmp_path / "node", 0o20600, os.fstat(slave).st_rdev)
            assert busy(str(tmp_path / "node"))
        assert not busy(str(tmp_path / "another"))
    assert not busy(device)
    os.close(master)
    os.close(slave)


@pytest.mark.parametrize(
    "host", ["localhost", "LOCALHOST", "127.0.1.1", "[::1]", "[::ffff:127.0.0.1]", "0.0.0.0"]
)
def test_port_lock_names_of_this_machine_are_one_host(host):
    number = PORT.rpartition(":")[2]
    with PortLock(PORT):
        for scheme, settings in (("tcp", ""), ("rtu+tcp", ""), ("tcp", "?tool=0,0,1")):
            assert busy(f"{scheme}://{host}:{number}{settings}")
        assert not busy(f"tcp://{host}:1{number}"[:-1])


def test_port_lock_of_a_name_holds_all_its_addresses(monkeypatch):
    def result(host, number, **_):
        addresses = ["192.0.2.7", "2001:db8::7"] if host == "cell.example" else [host]
        return [(0, 0, 0, "", (address, number)) for address in addresses]

    monkeypatch.setattr(locks.socket, "getaddrinfo", result)
    with PortLock("tcp://cell.example:5000"):
        assert busy("tcp://192.0.2.7:5000")
        assert busy("tcp://[2001:DB8:0::7]:5000")
        assert not busy("tcp://192.0.2.7:5001")
    with PortLock("tcp://192.0.2.7:5000"):
        assert busy("tcp://cell.example:5000")
        assert not busy("tcp://[2001:db8::7]:5000"), "a failed attempt releases all addresses"


def test_port_lock_of_unresolved_name_is_taken_in_time(monkeypatch):
    monkeypatch.setattr(locks, "LOOK_UP_S", 0.1)
    with silent_names(), PortLock("ur://robot.example"):
        assert busy("ur://robot.example:30004")


def test_port_lock_of_units_behind_gateway_is_per_unit():
    gateway = f"tcp://{HOST}:502"
    with PortLock(f"{gateway}?unit=9"):
        assert busy(gateway)
        assert busy(f"tcp://{HOST}")
        assert busy(f"{gateway}?unit=0x09&function=3")
        assert busy(f"rtu+{gateway}?output=1&unit=9")
        assert not busy(f"{gateway}?unit=10")
        with PortLock(f"rtu+{gateway}?unit=10"):
            assert busy(f"{gateway}?unit=0xA")


def test_port_lock_of_tty_ignores_make_in_port():
    with PortLock("/dev/null"):
        assert busy("dh:///dev/null?unit=3")
        assert not busy("dh:///dev/zero")


HOST = f"192.0.2.{os.getpid() % 250}"


@pytest.mark.parametrize(
    ("port", "same"),
    [
        ("ur://{}", "ur://{}:30004"),
        ("ur://{}?reach=850", "ur://{}:30002"),  # the port for its programs
        ("ur://{}:40004", "ur://{}:40002"),
        ("urcap://{}", "urcap://{}:63352"),
        ("urcap://{}", "rtu+tcp://{}:54321"),  # the same tool connector, forwarded
        ("omnicore://{}", "omnicore://{}:443?base=0,0,0"),
        ("omnicore://{}", "tcp://{}:5000"),  # open_abb on the same controller
        ("tcp://{}", "tcp://{}:502"),
        ("tcp://{}:5000", "manual+tcp://{}:5000"),
    ],
)
def test_port_lock_of_ports_of_one_device_is_shared(port, same):
    for one, other in ((port, same), (same, port)):
        with PortLock(one.format(HOST)):
            assert busy(other.format(HOST))
            assert not busy(other.format("192.0.2.251"))


def test_port_lock_usual_ports_equal_those_of_drivers():
    assert locks.USUAL["ur"] == rtde.PORT
    assert {rtde.PORT, rtde.PORT - SCRIPT_PORT_BELOW} <= locks.ONE_DEVICE[0]
    assert locks.USUAL["urcap"] == urcap.PORT
    assert locks.USUAL["omnicore"] == omnicore.PORT


def test_port_lock_is_never_held_by_two_contenders(tmp_path):
    command = [sys.executable, "-c", CONTENDER, PORT, str(tmp_path)]
    running = [started(command, stdin=subprocess.PIPE) for _ in range(3)]
    for process in running:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in running:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    refused = [int(process.communicate()[0]) for process in running]
    assert [process.returncode for process in running] == [0, 0, 0]
    assert sum(refused) > 0, "they never met, so nothing was shown"
    assert not list(tmp_path.iterdir())
