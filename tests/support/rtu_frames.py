"""Modbus RTU frames from the hexadecimal text of their unit and PDU."""

from drivers.sim.wire.modbus import crc16


def rtu_frame(text: str) -> bytes:
    """A frame with the CRC that belongs to it."""
    body = bytes.fromhex(text)
    return body + crc16(body)
