"""Modbus RTU frames from the hexadecimal text of their unit and PDU."""

from drivers.sim.wire.modbus import crc16


def rtu_frame(text: str) -> bytes:
    """The frame of a unit and PDU in hexadecimal, with its CRC."""
    body = bytes.fromhex(text)
    return body + crc16(body)
