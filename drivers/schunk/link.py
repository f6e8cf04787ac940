"""The parameters of a SCHUNK gripper over Modbus RTU."""

import threading
from functools import partial

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

from drivers.clock import Pace
from drivers.errors import LinkError
from drivers.modbus.master import Master
from drivers.ports import Report
from drivers.schunk.registers import PARAMETERS, Parameter
from drivers.stream import Stream

# A gripper reports ERR_COMM_LOST after a second or two without a request; [BKS] pauses for 0.5 s at most.
ALIVE_S = 0.2
# Parameter to resynchronise with. No other parameter that is read has as many registers, so a late answer to
# an earlier request is not taken for its answer. Once its answer is there, no earlier answer is pending.
FENCE = PARAMETERS["sw_version_txt"]


class SchunkLink(Master):
    """Reads and writes a gripper's parameters on a serial line, which this object owns.

    A thread sends a request whenever the line is silent; the gripper reports a long silence as an error.

    Args:
        stream: the line.
        pace: device time.
        report: receives every retry and failure.
        unit: slave id.
    """

    wrong_device = "check that it is a SCHUNK EGU or EGK, and the unit of its port's name"

    def __init__(self, stream: Stream, pace: Pace, report: Report, unit: int) -> None:
        super().__init__(stream, pace, report, unit)
        self._line = threading.Lock()
        # whether a keep-alive request is under way, whose failures are not reported
        self._quiet = False
        self._let_go = pace.every(ALIVE_S, self._keep_alive)

    def read(self, name: str) -> tuple[float, ...]:
        """Reads the elements of a parameter; up to 3 attempts, since reading changes nothing."""
        return self._repeated(partial(self._read_once, PARAMETERS[name]))

    def write(self, name: str, *values: float) -> None:
        """Writes the elements of a parameter; the request is sent once, and never repeated."""
        parameter = PARAMETERS[name]
        self._write_data(parameter.address, parameter.pack(*values))

    def transact(self, request: ModbusPDU) -> ModbusPDU:
        """Sends a request once and returns its answer, never an answer to an earlier request."""
        with self._line:
            return self._in_step(request)

    def close(self) -> None:
        """Disconnects; moves nothing, but the gripper soon reports ERR_COMM_LOST."""
        self._let_go()
        super().close()

    def _in_step(self, request: ModbusPDU) -> ModbusPDU:
        if self._out_of_step:
            super().transact(self._question(FENCE))
        return super().transact(request)

    def _read_once(self, parameter: Parameter) -> tuple[float, ...]:
        return parameter.unpack(self._read_data(self._question(parameter)))

    def _question(self, parameter: Parameter) -> ModbusPDU:
        at, count = parameter.address, parameter.registers
        return ReadHoldingRegistersRequest(address=at, count=count, dev_id=self._unit)

    def _keep_alive(self) -> None:
        """Sends a request if the line was silent; ignores errors, since the next caller will meet them."""
        idle_s = self._pace.elapsed(self._free_at)
        if idle_s < ALIVE_S or self._lost or not self._line.acquire(blocking=False):
            return
        self._quiet = True
        try:
            self._in_step(self._question(PARAMETERS["plc_sync_input"]))
        except LinkError:
            pass
        finally:
            self._quiet = False
            self._line.release()

    def _tell(self, incident: str, **details: object) -> None:
        if not self._quiet:  # a journal is used by one thread
            super()._tell(incident, **details)
