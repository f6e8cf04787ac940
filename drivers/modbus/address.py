"""Port names with a Modbus unit, such as `make:///dev/ttyUSB0?unit=2` or `make://host:port?unit=2`."""

from urllib.parse import parse_qsl

from drivers.errors import PortError
from drivers.stream import SerialStream, Stream, open_tcp, tcp_address


def unit_of(port: str, usual: int) -> int:
    """Parses the unit in a port's name; returns `usual` if the name states none.

    Raises:
        PortError: the stated unit is invalid.
    """
    stated = parse_qsl(port.partition("?")[2], keep_blank_values=True) or [("unit", str(usual))]
    unit = int(stated[0][1]) if stated[0][1].isdecimal() else 0
    if len(stated) > 1 or stated[0][0] != "unit" or not 1 <= unit <= 247:
        scheme = port.partition(":")[0]
        raise PortError(
            f"port {port} is not understood; write it as {scheme}:///dev/ttyUSB0?unit={usual}, unit 1 to 247"
        )
    return unit


def opened(port: str, baud: int, parity: str = "N") -> Stream:
    """Opens the serial port that a port name states, or connects to the serial device server that it states.

    Raises:
        PortError: the port cannot be opened, or its name is invalid.
    """
    address = port.partition("?")[0]
    path = address.partition("://")[2]
    if path.startswith("/"):
        return SerialStream(path, baud, parity)
    return open_tcp(*tcp_address(address), port, "check address, cable and power")
