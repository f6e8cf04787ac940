"""Device logic of a Robotiq 2F gripper: activation, moves, and detection of stale flags.

It follows the 2F-85 manual ([M18] p54-62) and Robotiq's own SDK (`gripper.cpp`, `gripper_state.cpp`).
"""

from typing import Protocol

from drivers.errors import GripperFault
from drivers.polling import Move, PolledGripper
from drivers.ports import GripperProfile, GripperState, ObjectState
from drivers.robotiq import registers as robotiq
from drivers.robotiq.counts import Counts
from drivers.robotiq.registers import OUTPUT_FIELDS, Reading, decode, fault, is_major, pack

# Time limit for reset, sweep and report together ([SDK] gripper.cpp; 5 s was too short for some).
ACTIVATION_S = 15.0
# Pause between two readings of fingers at rest: the time for so many counts at the requested speed.
SETTLE_COUNTS = 1.0
# Distance from the request above which gOBJ 3 contradicts the count; open jaws stop at 3 to 13.
ARRIVED_COUNTS = 12
COMM_SILENCE = 0x09


class Link(Protocol):
    """Reads and writes the two register blocks of a gripper, on any bus.

    In both directions a LinkTimeout means that there was no valid answer, and any other LinkError that the
    connection is gone or the device refuses.
    """

    endpoint: str

    def read(self) -> bytes:
        """Reads the input block, 6 bytes; may retry."""

    def write(self, block: bytes) -> None:
        """Writes the output block, 6 bytes, exactly once; after a timeout its arrival is unknown."""

    def close(self) -> None:
        """Closes the link without moving anything."""


class Gripper(PolledGripper[Reading, int]):
    """Driver of a Robotiq 2F gripper; the target of a move is a count (rPR). Connecting only reads."""

    stale_s = 0.2  # time during which gOBJ may belong to the previous move ([SDK] gripper.cpp)

    _link: Link

    def _begin(self, profile: GripperProfile | None) -> GripperProfile:
        self._counts = Counts(profile)
        # Initialised from the gripper's state, so that the first write cannot move a holding
        # gripper.
        seen = self._read()
        self._image = {"rACT": int(seen.enabled), "rGTO": int(seen.going), "rPR": seen.echo_counts}
        return self._counts.profile

    def activate(self) -> None:
        """Resets and activates: the jaws sweep fully open and closed; a held part is dropped.

        The reset clears a latched fault. An active gripper without a major fault is left unchanged; an
        activation in progress is only waited for.
        """
        seen = self._read()
        if seen.activated and not is_major(seen.fault):
            return
        deadline = self._pace.deadline(ACTIVATION_S)
        if is_major(seen.fault) or not seen.activating:
            self._send({})
            self._until(lambda now: not now.enabled, deadline, "resetting")
            self._send({"rACT": 1})
        self._until(lambda now: now.activated, deadline, "activating", _refuse_latched)

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        """Requests a width (rPR), a speed (rSP) and a force (rFR); `wait` returns the result."""
        self._move = None
        seen = self._checked("asked to move")
        counts = self._counts.request(width_um)
        setting = self._counts.speed(speed_mm_s)
        request = {"rACT": 1, "rGTO": 1, "rPR": counts, "rSP": setting}
        self._send({**request, "rFR": self._counts.force(force_n)})
        mm_per_count = robotiq.OPENING_MM / (robotiq.COUNT_CLOSED - robotiq.COUNT_OPEN)
        count_s = mm_per_count / robotiq.speed_mm_s_of(setting)
        now = self._asked_at = self._pace.now()
        budget_s = self._budget_s(robotiq.speed_mm_s_of(setting))
        self._move = Move(counts, seen, now, budget_s, SETTLE_COUNTS * count_s)

    def stop(self) -> None:
        """Stops the jaws where they are; a held part stays held.

        The requested count is kept. An activation in progress is ended by a reset.
        """
        self._move = None
        seen = self._read()
        if seen.activating or (seen.enabled and not seen.activated and not seen.fault):
            self._send({})  # the sweep depends only on rACT, not on rGTO ([M18] p54)
        # A gripper that lost power does not move, and writing rACT to it would start the activation sweep.
        elif seen.enabled:
            self._send({**self._image, "rACT": 1, "rGTO": 0, "rPR": seen.echo_counts})

    def _read(self) -> Reading:
        seen = decode(self._link.read())
        if seen.fault == COMM_SILENCE:
            # Fault 9 reports the silence before this request; the next reading is current.
            seen = decode(self._link.read())
        return seen

    def _target(self, seen: Reading) -> int:
        return seen.echo_counts

    def _state(self, seen: Reading, target: int) -> GripperState:
        # Fault 9 reports a silence, which this request has ended.
        code = 0 if seen.fault == COMM_SILENCE else seen.fault
        return GripperState(
            activated=seen.activated,
            moving=seen.moving,
            fault=code,
            fault_text=f"0x{code:02X}, {robotiq.fault_text(code)}" if code else "",
            object=ObjectState(seen.object_flag),
            target_um=self._counts.target_um(target),
            width_um=self._counts.width_um(seen.position_counts),
            current_ma=seen.current_ma,
        )

    def _rest(self, seen: Reading, move: Move[Reading, int]) -> int | None:
        return seen.position_counts if self._fits(seen, move) else None

    def _fits(self, seen: Reading, move: Move[Reading, int]) -> bool:
        """Whether gOBJ is final and agrees with the count; a stale or stuck gOBJ usually disagrees."""
        if seen.moving or not seen.going:
            return False
        asked, start = move.target, move.before.position_counts
        if seen.object_flag == robotiq.OBJ_AT_REQUEST:
            # Beyond the end stops the final position depends on the fingers.
            short = min(asked, robotiq.COUNT_CLOSED) - seen.position_counts
            beyond = seen.position_counts - max(asked, robotiq.COUNT_OPEN)
            closes = asked >= robotiq.COUNT_CLOSED
            return short <= ARRIVED_COUNTS and (closes or beyond <= ARRIVED_COUNTS)
        way = asked - seen.position_counts
        if abs(way) <= ARRIVED_COUNTS:  # too close to give the direction; the start gives it
            way = asked - start
        return way == 0 or (seen.object_flag == robotiq.OBJ_CONTACT_CLOSING) == (way > 0)

    def _require_ready(self, seen: Reading, doing: str) -> None:
        if seen.fault and seen.fault not in robotiq.MINOR:
            raise fault(seen.fault, doing)
        if not seen.activated:
            raise GripperFault(
                f"gripper not active while {doing}; clear the jaws and activate it (--activate)"
            )

    def _sketch(self, seen: Reading) -> str:
        return (
            f"gOBJ {seen.object_flag}, request {seen.echo_counts}, position {seen.position_counts}, "
            f"fault 0x{seen.fault:02X}"
        )

    def _send(self, image: dict[str, int]) -> None:
        """Writes the output block with the values of `image`, until a write is acknowledged.

        A write without an acknowledgement is repeated even if the gripper echoes `image`: the input block
        does not echo speed and force.
        """
        block = pack(OUTPUT_FIELDS, image)
        self._repeat(lambda: self._link.write(block), lambda: self._arrived(image))
        self._image = image

    def _arrived(self, image: dict[str, int]) -> bool:
        seen = self._read()
        sweeps = not seen.enabled and self._image.get("rACT") == image.get("rACT") == 1
        # rACT set in a gripper that lost power starts the sweep.
        if image.get("rGTO") == 1 or sweeps:
            self._require_ready(seen, "repeating a write whose answer was lost")
        wanted = (image.get("rACT", 0) == 1, image.get("rGTO", 0) == 1, image.get("rPR", 0))
        return (seen.enabled, seen.going, seen.echo_counts) == wanted


def _refuse_latched(seen: Reading, doing: str) -> None:
    if is_major(seen.fault):
        raise fault(seen.fault, doing)
