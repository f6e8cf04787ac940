"""SCHUNK's parameters agree with the examples of its manual and with dumps of real grippers."""

import random

import pytest
from rtu_frames import rtu_frame

from drivers.schunk.registers import ERRORS, PARAMETERS, Input, Output, Status, error_text
from drivers.sim.devices.schunk import SchunkModel, SchunkRegisters
from drivers.sim.wire.modbus import crc16
from drivers.sim.wire.rtu import RtuSlave
from runtime.table import PROFILES


def slave():
    model = SchunkModel(random.Random(1), None, PROFILES["schunk-egu"])
    return RtuSlave(SchunkRegisters(model, lambda: 0.0), None, 12)


def test_schunk_registers_read_of_manual_is_answered_by_sixteen_bytes():
    request = bytes.fromhex("0C 03 00 3F 00 08 75 1D")
    reply = slave().reply(request)
    assert reply[:3] == bytes.fromhex("0C 03 10")
    assert (len(reply), crc16(reply[:-2])) == (21, reply[-2:])


def test_schunk_model_at_power_on_answers_like_real_gripper():
    """The dump is of an EGU 60: error and brake bits, 0.251 mm, error 0xD9, all control bits set."""
    dumped = bytes.fromhex("80000080FB00000000000000D9000000")
    status, *rest = PARAMETERS["plc_sync_input"].unpack(dumped)
    seen = Input(Status(status), *rest)
    assert seen == Input(Status.ERROR | Status.GPE_ACTIVE, 251, 0, 0xD9, 0, 0)
    reply = slave().reply(bytes.fromhex("0C 03 00 3F 00 08 75 1D"))[3:-2]
    assert (reply[:4], reply[12:]) == (dumped[:4], dumped[12:])
    control = Output(*PARAMETERS["plc_sync_output"].unpack(bytes.fromhex("FFFFFFFF" + 24 * "0")))
    assert control.control == 0xFFFFFFFF


@pytest.mark.parametrize(
    ("name", "dumped", "value"),
    [("max_vel", "0000DC42", 110.0), ("max_grp_force", "00802244", 650.0)],
)
def test_parameter_bytes_are_little_endian(name, dumped, value):
    assert PARAMETERS[name].unpack(bytes.fromhex(dumped)) == (value,)
    assert PARAMETERS[name].pack(value) == bytes.fromhex(dumped)


@pytest.mark.parametrize(
    "body",
    [
        "0C 03 00 40 00 08",  # not from its first register
        "0C 03 00 3F 00 04",  # a part of a parameter
        "0C 03 00 3F 00 10",  # more than a parameter
        "0C 04 00 3F 00 08",  # other functions
        "0C 06 00 FF 00 8B",
        "0D 03 00 3F 00 08",  # another unit
        f"0C 10 06 2F 00 02 04 {PARAMETERS['max_vel'].pack(5.0).hex()}",  # a read-only parameter
    ],
)
def test_schunk_registers_request_not_served_is_silent(body):
    assert slave().reply(rtu_frame(body)) is None


def test_error_text_has_meaning_and_remedy():
    for code in [*ERRORS, 0x01]:
        text = error_text(code)
        assert all(text.split("; "))
        assert "; " in text
        assert "\n" not in text
