"""A Robotiq gripper as a state machine over simulated time, without I/O or clock.

It behaves as the 2F-85 manual ([M18] p54-62) and Robotiq's SDK say.
"""

import math
from collections.abc import Callable
from functools import lru_cache

from drivers.robotiq import registers as robotiq
from drivers.robotiq.counts import MODEL
from drivers.robotiq.modbus import RTU, TCP, Wiring
from drivers.robotiq.registers import INPUT_FIELDS, OUTPUT_FIELDS, is_major, pack, unpack
from drivers.sim.devices.jaws import Fingers
from runtime.shell.errors import UsageError

SILENCE_S = 1.0  # silence that causes fault 0x09 until traffic returns ([SDK] fault_status.hpp)
SWEEP_MM_S = 60.0  # activation: two strokes in about 3 s
RELEASE_MM_S = 20.0  # automatic release is slow ([M18] p62)

CURRENT_MOVING, CURRENT_CONTACT, CURRENT_PER_FORCE = 12.0, 20.0, 0.2  # counts of 10 mA
CURRENT_HOLD, CURRENT_DECAY_S = 0.3, 0.15  # the screw drive holds with less than it grips

FAULT_DELAYED, FAULT_INACTIVE, FAULT_SILENCE = 0x05, 0x07, 0x09
FAULT_RELEASING, FAULT_BLOCKED_SWEEP, FAULT_RELEASED = 0x0B, 0x0D, 0x0F
LEAST_MAJOR = 0x0A  # scheduled faults with a lower code only show in readings, and stop nothing

BLOCK_WORDS = 8
GOES = 0x08  # rGTO in byte 0 of the output block
# Supported function codes; [M200] p66 promises no others over Modbus TCP.
FUNCTIONS = {RTU: frozenset({3, 4, 6, 16, 23}), TCP: frozenset({4, 16})}


@lru_cache(4096)
def input_block(**fields: int) -> bytes:
    """The 16 input bytes that contain the values of these fields."""
    return pack(INPUT_FIELDS, fields) + bytes(10)


class GripperModel(Fingers):
    """A Robotiq gripper from power-up on. Times are simulated seconds and never go back.

    After a request, gOBJ changes later than the echo of the request ([SDK] gripper.cpp waits for it).

    Raises:
        UsageError: the readings of the model are not counts.
    """

    CLOSING = 1.0
    CYCLE_S = 1.0 / 200.0  # internal refresh ([M16] p55)
    MODEL = MODEL

    def _begin(self) -> None:
        if self.profile.counts is None:
            raise UsageError(
                f"no simulated {self.profile.model} reads in steps of {self.profile.resolution_um:g} um; "
                "leave resolution_mm out of the job, and compile it again"
            )
        self._open, self._closed = self.profile.counts
        self._counts_per_mm = (self._closed - self._open) / (self.profile.stroke_um / 1000.0)
        self._heard_s = self._silent_until_s = 0.0

    def _forget(self) -> None:
        """Resets to the state after a power failure: all outputs are 0; the screw drive holds the jaws."""
        self._output = bytearray(16)
        self._request = unpack(OUTPUT_FIELDS, self._output)
        self._show(robotiq.OBJ_MOVING)
        self._reset(0)

    def _reset(self, fault: int) -> None:
        """Stops the fingers, deactivates the gripper and sets its fault code; 0: no fault."""
        self._stand()
        self._legs: list[int] = []  # counts that the activation sweep still has to visit
        self._status, self._fault = robotiq.STA_RESET, fault

    # -- the two register blocks ------------------------------------------------------------------

    def read_input(self, now_s: float) -> bytes:
        """Returns the 16 input bytes as of the last refresh before `now_s`; echoes of requests are immediate.

        Each call counts as one request, hence as one event of the fault schedule.
        """
        self.next_request(now_s)
        self._refresh(now_s)
        request, state = self._request, self._flag.at(self._now)
        going = request["rGTO"] if self._ready() else 0
        misstated = self._misstated(moving=bool(going) and state == robotiq.OBJ_MOVING)
        fault = self._fault or (FAULT_SILENCE if now_s < self._silent_until_s else 0)
        for code in (each.code for each in self._faults):
            fault = code if 0 < code < LEAST_MAJOR else fault
        return input_block(
            gACT=request["rACT"],
            gGTO=going,
            gSTA=self._status,
            gOBJ=state if misstated is None else misstated,
            gFLT=fault,
            gPR=request["rPR"],
            gPO=self._misread(round(self._here())),
            gCU=round(self._current()),
        )

    def read_output(self) -> bytes:
        """The 16 output bytes as last written."""
        return bytes(self._output)

    def write_output(self, offset: int, data: bytes, now_s: float) -> None:
        """Writes bytes to the output block from an offset on, and executes the command in the block."""
        self.next_request(now_s)
        self.advance(now_s)
        self._output[offset : offset + len(data)] = data
        old, self._request = self._request, unpack(OUTPUT_FIELDS, self._output)
        self._obey(old)

    def hang_up(self, now_s: float) -> None:
        """Stops the jaws (rGTO = 0), as the gripper does when a Modbus TCP connection closes ([M200] p66)."""
        self.write_output(0, bytes((self._output[0] & ~GOES,)), now_s)

    def next_request(self, now_s: float) -> None:
        """Counts one more request, and notes whether it ends a silence longer than `SILENCE_S`.

        Reads within `CYCLE_S` after such a request still report the silence as a fault.
        """
        super().next_request(now_s)
        # The register reports the silence until the next refresh, so the first answer does too.
        if now_s - self._heard_s > SILENCE_S:
            self._silent_until_s = now_s + self.CYCLE_S
        self._heard_s = now_s

    def opening_mm(self, now_s: float) -> float:
        """True distance between the fingers, mm."""
        self.advance(now_s)
        return (self._closed - self._here()) / self._counts_per_mm

    def _met_at(self, width_mm: float) -> float:
        count = round(self._closed - width_mm * self._counts_per_mm)
        return min(max(count, self._open), self._closed)

    # -- mishaps ----------------------------------------------------------------------------------

    def fail(self, code: int, now_s: float) -> None:
        """Starts a major fault: the jaws stop, and nothing moves them before a reset."""
        self.advance(now_s)
        self._reset(code)

    def _report(self, code: int, now_s: float) -> None:
        if code == FAULT_RELEASING:  # as rATR with rARD for opening
            self.advance(now_s)
            self._release(opens=True)
        elif code >= LEAST_MAJOR:
            self.fail(code, now_s)

    def _dropped(self) -> None:
        """Called when the held part is lost: the jaws go on closing to the requested position."""
        if self._ready() and self._request["rGTO"]:
            self._go(meets=False)

    # -- commands ---------------------------------------------------------------------------------

    def _ready(self) -> bool:
        return self._status == robotiq.STA_ACTIVE and not is_major(self._fault)

    def _obey(self, old: dict[str, int]) -> None:
        new = self._request
        if not new["rACT"]:
            self._reset(FAULT_INACTIVE if new["rGTO"] else 0)
        elif not old["rACT"]:
            self._reset(FAULT_DELAYED if new["rGTO"] else 0)
            self._status = robotiq.STA_ACTIVATING
            self._legs = [self._closed, self._open]
            self._drive(float(self._open), SWEEP_MM_S)
        elif is_major(self._fault):
            pass
        elif new["rATR"]:
            self._release(opens=new["rARD"] == 1)  # manuals disagree about the direction
        elif self._status == robotiq.STA_ACTIVATING:
            self._fault = FAULT_DELAYED if new["rGTO"] else 0
        elif not new["rGTO"]:
            self._stand()
        elif any(old[name] != new[name] for name in ("rGTO", "rPR", "rSP")):
            self._go()

    def _release(self, *, opens: bool) -> None:
        self._reset(FAULT_RELEASING)
        self._drive(float(self._open if opens else self._closed), RELEASE_MM_S)

    def _go(self, *, meets: bool = True) -> None:
        target = float(min(max(self._request["rPR"], self._open), self._closed))
        self._drive(target, robotiq.speed_mm_s_of(self._request["rSP"]), meets=meets)
        self._follow()

    # -- motion -----------------------------------------------------------------------------------

    def _drive(self, target: float, speed_mm_s: float, *, meets: bool = True) -> None:
        speed = speed_mm_s * self._counts_per_mm
        outcomes = robotiq.OBJ_AT_REQUEST, robotiq.OBJ_CONTACT_CLOSING
        self._start(target, speed, outcomes, meets=meets)

    def _stand(self) -> None:
        self._show(self._flag.at(self._now))
        if self._ends_s < math.inf:
            self._halt(robotiq.OBJ_MOVING)

    def _arrived(self) -> None:
        """Called when a stroke has ended: continues the activation sweep, or ends activation or release."""
        if self._fault == FAULT_RELEASING:
            self._fault = FAULT_RELEASED
        elif self._status == robotiq.STA_ACTIVATING and self._meets:
            self._reset(FAULT_BLOCKED_SWEEP)
        elif self._status == robotiq.STA_ACTIVATING and self._legs:
            self._drive(float(self._legs.pop(0)), SWEEP_MM_S)
        elif self._status == robotiq.STA_ACTIVATING:
            self._status, self._fault = robotiq.STA_ACTIVE, 0
            self._show(robotiq.OBJ_AT_REQUEST)
            if self._request["rGTO"]:
                self._go()

    def _current(self) -> float:
        """Motor current in counts of 10 mA: constant while moving, peak at contact, then decay to holding."""
        if self._ends_s < math.inf and self._stroke.rate:
            return CURRENT_MOVING
        if not self._gripping:
            return 0.0
        peak = CURRENT_CONTACT + CURRENT_PER_FORCE * self._request["rFR"]
        since = self._now - self._stroke.end_s
        return peak * (CURRENT_HOLD + (1.0 - CURRENT_HOLD) * math.exp(-since / CURRENT_DECAY_S))


class GripperRegisters:
    """The two register blocks of a Robotiq gripper at their wire addresses.

    Args:
        device: the gripper.
        now: simulated seconds.
        wiring: addresses of the blocks on one kind of link.
    """

    def __init__(
        self, device: GripperModel, now: Callable[[], float], wiring: Wiring = RTU
    ) -> None:
        self._device = device
        self._now = now
        self._output = wiring.output
        self._input = wiring.input
        self.functions = FUNCTIONS[wiring]

    def serves(self, address: int, count: int) -> bool:
        """Whether all registers lie in one of the blocks."""
        return _inside(address, count, self._input) or _inside(address, count, self._output)

    def read(self, address: int, count: int) -> bytes:
        """Reads registers of the input block, or of the output block as last written."""
        if _inside(address, count, self._input):
            block, base = self._device.read_input(self._now()), self._input
        else:
            block, base = self._device.read_output(), self._output
        return block[2 * (address - base) : 2 * (address - base + count)]

    def write(self, address: int, data: bytes) -> bool:
        """Writes to the output block; returns False for any other address."""
        if not _inside(address, len(data) // 2, self._output):
            return False
        self._device.write_output(2 * (address - self._output), data, self._now())
        return True


def _inside(address: int, count: int, base: int) -> bool:
    return count > 0 and base <= address and address + count <= base + BLOCK_WORDS
