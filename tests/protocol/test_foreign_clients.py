"""Clients that others wrote for the real devices work with the simulated cell without changes.

They are pymodbus and minimalmodbus as masters, pyrobotiqur as client of the URCap, and the message formats of
`abb.py` of open_abb over a plain socket.
"""

import random
import socket
import time

import minimalmodbus
import pyrobotiqur
import pytest
from fake_scene import setting
from programs import until
from pymodbus import FramerType, ModbusException
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from drivers.sim.cell import Cell

SCALE = 20.0
ACTIVATE, CLOSE, OPEN = [0x0100, 0, 0], [0x0900, 0x00FF, 0xFFFF], [0x0900, 0x0000, 0xFFFF]


@pytest.fixture
def cell():
    with Cell(setting(), 3, SCALE) as result:
        yield result


def address(url):
    host, port = url.split("://")[1].split(":")
    return host, int(port)


def master(cell, kind):
    """A pymodbus client for a kind of port, with what it needs for requests.

    Returns:
        The client, the gripper's unit, and the addresses of the blocks to write and to read.
    """
    if kind == "pty":
        port = cell.endpoints["gripper"]
        client = ModbusSerialClient(port, baudrate=115200, timeout=0.2, retries=0)
        return client, 9, 1000, 2000
    host, port = address(cell.endpoints["gripper_tcp" if kind == "tcp" else "gripper_rtu_tcp"])
    framer = FramerType.SOCKET if kind == "tcp" else FramerType.RTU
    client = ModbusTcpClient(host, port=port, framer=framer, timeout=0.2, retries=0)
    return (client, 2, 0, 0) if kind == "tcp" else (client, 9, 1000, 2000)


def seen_by(read, done):
    """Calls `read` until `done` holds for the registers that it returns; returns these."""
    return until(lambda: [registers for registers in (read(),) if done(registers)])[0]


@pytest.mark.parametrize("kind", ["pty", "rtu+tcp", "tcp"])
def test_cell_pymodbus_master_moves_gripper_and_bad_requests_fail(cell, kind):
    client, unit, output, inputs = master(cell, kind)
    assert client.connect()
    read = lambda: client.read_input_registers(inputs, count=3, device_id=unit).registers  # noqa: E731
    assert read()[0] >> 8 & 0x31 == 0
    assert not client.write_registers(output, ACTIVATE, device_id=unit).isError()
    assert read()[0] >> 8 == 0x11
    seen_by(read, lambda seen: seen[0] >> 8 & 0x31 == 0x31)
    client.write_registers(output, CLOSE, device_id=unit)
    seen = seen_by(read, lambda seen: seen[0] >> 8 == 0xF9 and seen[2] >> 8 > 200)
    assert (seen[1] & 0xFF, seen[2] >> 8) == (0xFF, 230)
    client.write_registers(output, OPEN, device_id=unit)
    seen = seen_by(read, lambda seen: seen[0] >> 8 == 0xF9 and seen[2] >> 8 < 20)
    assert (seen[1] & 0xFF, seen[2] >> 8) == (0, 3)
    for ask in (
        lambda: client.read_input_registers(inputs, count=3, device_id=unit + 1),
        lambda: client.read_coils(inputs, count=3, device_id=unit),
        lambda: client.write_registers(5000, [1], device_id=unit),
    ):
        with pytest.raises(ModbusException):
            ask()
        assert not client.read_input_registers(inputs, count=3, device_id=unit).isError()
    if kind == "pty":
        written = {"write_address": output, "values": [0x0900, 100, 0xFF00]}
        places = {"read_address": inputs, "read_count": 3, **written}
        reply = client.readwrite_registers(**places, device_id=unit)
        assert reply.registers[1] & 0xFF == 100
    client.close()


def test_cell_minimalmodbus_master_moves_gripper(cell):
    device = minimalmodbus.Instrument(cell.endpoints["gripper"], 9)
    device.serial.baudrate, device.serial.timeout = 115200, 0.3
    device.write_registers(1000, ACTIVATE)
    for function in (3, 4):
        seen_by(
            lambda function=function: device.read_registers(2000, 3, functioncode=function),
            lambda seen: seen[0] >> 8 & 0x31 == 0x31,
        )
    device.write_registers(1001, [50, 0xFF00])  # rPR first, as some drivers do
    device.write_register(1000, 0x0900, functioncode=6)
    seen = seen_by(lambda: device.read_registers(2000, 3), lambda seen: seen[2] >> 8 == 50)
    assert seen[1] & 0xFF == 50
    device.address = 8
    with pytest.raises(minimalmodbus.NoResponseError):
        device.read_registers(2000, 3)
    device.serial.close()


class AbbPy:
    """A client that sends and parses open_abb's messages as that project's Python client does."""

    def __init__(self, url):
        self.socket = socket.create_connection(address(url), timeout=5.0)

    def ask(self, code, *numbers):
        self.socket.send(" ".join((code, *numbers, "#")).encode())
        return self.socket.recv(4096).decode()

    @staticmethod
    def pose(x, y, z, *q):
        return (*(f"{v:+08.1f}" for v in (x, y, z)), *(f"{v:+08.5f}" for v in q))


def test_cell_messages_of_open_abb_client_are_understood(cell):
    robot = AbbPy(cell.endpoints["arm"].partition("?")[0])
    assert robot.ask("06", *robot.pose(0, 0, 0, 1, 0, 0, 0)) == "6 1 "
    assert robot.ask("07", *robot.pose(0, 0, 0, 1, 0, 0, 0)) == "7 1 "
    assert robot.ask("08", "+00100.0", "+0050.00", "+00050.0", "+0050.00") == "8 1 "
    assert robot.ask("09", "0", "+05.0000", "+08.0000", "+00.8000") == "9 1 "
    assert robot.ask("01", *robot.pose(20.04, -10, 90, 0, 1, 0, 0)) == "1 1 "
    pose = [float(text) for text in robot.ask("03").split(" ")]
    # A fly-by point may be under way.
    assert pose[2:5] == pytest.approx([20.0, -10.0, 90.0], abs=5.0)
    joints = [float(text) for text in robot.ask("04").split(" ")][2:8]
    assert len(joints) == 6
    assert robot.ask("02", *(f"{angle:+08.2f}" for angle in joints)) == "2 1 "
    assert robot.ask("98")[5:].split("*")[1].startswith("ROBOTWARE")
    assert robot.ask("31") == "31 1 "
    for k in range(3):
        assert robot.ask("30", *robot.pose(10 * k, 0, 80, 0, 1, 0, 0)) == "30 1 "
    assert float(robot.ask("32").split(" ")[2]) == 3
    assert robot.ask("33") == "33 1 "
    robot.socket.close()


def test_cell_arm_logger_streams_poses_and_joints(cell):
    with socket.create_connection(address(cell.endpoints["arm_logger"]), timeout=5.0) as stream:
        text = ""
        while text.count("#") < 7:
            text += stream.recv(64).decode()
    records = [record.split() for record in text.split("#")[1:6]]
    assert [record[0] for record in records] == ["0", "1", "0", "1", "0"]
    assert [len(record) for record in records] == [11, 10, 11, 10, 11]
    assert [float(v) for v in records[0][4:7]] == [0.0, 0.0, 100.0]
    times = [float(record[3]) for record in records]
    assert times == sorted(times)


def answer(client, inputs, unit):
    """The registers that the gripper answers; empty if the request merged with earlier noise on the line."""
    time.sleep(0.03)  # silence that ends a frame
    client.socket.reset_input_buffer()
    try:
        return client.read_holding_registers(inputs, count=3, device_id=unit).registers
    except ModbusException:
        return []


def test_cell_noise_on_serial_line_moves_nothing(cell):
    client, unit, output, inputs = master(cell, "pty")
    assert client.connect()
    rng = random.Random(4)
    for _ in range(8):
        client.socket.write(rng.randbytes(rng.randrange(1, 40)))
        assert until(lambda: answer(client, inputs, unit))[0] == 0
    assert client.read_holding_registers(output, count=3, device_id=unit).registers == [0, 0, 0]
    client.close()


def test_cell_pyrobotiqur_client_moves_gripper(cell):
    host, port = address(cell.endpoints["gripper_urcap"])
    with pyrobotiqur.RobotiqGripper(host, port) as client:
        client.activate(poll_interval=0.01)
        assert client.get_status() == 3
        # pyrobotiqur may take the object flag of the previous move for the new one, so the test polls.
        client.close()
        until(lambda: client.get_position() == 230)
        client.open()
        until(lambda: client.get_position() == 3)
        until(lambda: client.get_object_status() == 3)
        client.move(100, wait=False)
        assert client.get_requested_position() == 100
        with pytest.raises(ValueError, match="Unexpected"):
            client.get_var("XYZ")


def test_cell_urcap_port_serves_several_clients_at_once(cell):
    host, port = address(cell.endpoints["gripper_urcap"])
    clients = [socket.create_connection((host, port), timeout=5.0) for _ in range(3)]
    for client in clients:
        client.sendall(b"GET STA\nGET")
        assert client.recv(100) == b"STA 0\n"
    for client in clients:
        client.sendall(b" ACT\n")
        assert client.recv(100) == b"ACT 0\n"
        client.close()
