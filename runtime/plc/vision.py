"""Shows a PLC's station in the terms of a production line: states of OPC 40100-1 and PackML, stop reasons.

The module decides nothing: it only derives from the handshake's state what to show. `VIEW` maps each state to
those of the two standards; `tools/docs/plc.md` shows it. The module does not import asyncua.
"""

from collections.abc import Callable, Mapping
from enum import Enum, IntEnum
from math import nan
from typing import NamedTuple

from runtime.plc.handshake import SIGNALS, Error
from runtime.plc.registers import OUTCOMES, UNKNOWN
from runtime.plc.station import FAULT, Answer, Glance
from runtime.shell.exit_codes import ExitCode


class VisionState(Enum):
    """States of the OPC UA specification for machine vision (OPC 40100-1); values are the names there."""

    PREOPERATIONAL = "Preoperational"
    HALTED = "Halted"
    ERROR = "Error"
    INITIALIZED = "Initialized"
    READY = "Ready"
    SINGLE_EXECUTION = "SingleExecution"

    @property
    def automatic(self) -> bool:
        """Whether the state is one of the automatic mode, which is a part of the state Operational."""
        return self in _AUTOMATIC

    @property
    def outer(self) -> str:
        """Name that the specification's top-level state machine shows for the state."""
        return "Operational" if self.automatic else self.value


_AUTOMATIC = {VisionState.INITIALIZED, VisionState.READY, VisionState.SINGLE_EXECUTION}


class PackMLState(IntEnum):
    """The states of PackML (ISA-TR88.00.02) that a station may show."""

    STOPPED = 2
    IDLE = 4
    EXECUTE = 6
    ABORTED = 9
    COMPLETE = 17


class Row(NamedTuple):
    """A row of `VIEW`: a state of OPC 40100-1 and one of PackML, and the condition for showing both."""

    state: VisionState
    packml: PackMLState
    when: str  # the condition in the words of the documentation
    holds: Callable[[Glance], bool]  # whether the condition holds for a station


def waits(seen: Glance) -> bool:
    """Whether a station has a result that waits for the PLC to take it."""
    return SIGNALS[seen.state].result_valid


def _failed(seen: Glance) -> bool:
    return waits(seen) and seen.answer.outcome == FAULT


def _works(seen: Glance) -> bool:
    return SIGNALS[seen.state].busy


# The states to show for a station: those of the first row whose condition holds.
VIEW: tuple[Row, ...] = (
    Row(VisionState.ERROR, PackMLState.ABORTED, "the result of a fault waits", _failed),
    Row(VisionState.SINGLE_EXECUTION, PackMLState.EXECUTE, "a part is under way", _works),
    Row(VisionState.SINGLE_EXECUTION, PackMLState.COMPLETE, "another result waits", waits),
    Row(VisionState.HALTED, PackMLState.STOPPED, "the run has ended", lambda seen: seen.ended),
    Row(
        VisionState.PREOPERATIONAL,
        PackMLState.STOPPED,
        "automatic mode is not selected",
        lambda seen: not seen.enabled,
    ),
    Row(
        VisionState.INITIALIZED,
        PackMLState.STOPPED,
        "no recipe is prepared",
        lambda seen: seen.table is None,
    ),
    Row(VisionState.READY, PackMLState.IDLE, "StartSingleJob is accepted", lambda _: True),
)


def view(seen: Glance) -> Row:
    """The states to show for a station: the first row of `VIEW` whose condition holds."""
    return next(row for row in VIEW if row.holds(seen))


# Reasons for a stopped line, by exit code of the last part or by `error_id`.
STOP_REASONS: Mapping[int, str] = {
    0: "none",
    ExitCode.NOT_LOCATED: "part not located",
    ExitCode.DEVICE: "device fault",
    ExitCode.UNREACHABLE: "device not reached",
    ExitCode.JOURNAL: "journal not written",
    ExitCode.STOPPED: "stop request",
    Error.CONNECTION_LOST.value: "connection of the master lost",
}


def stop_reason(before: Glance, after: Glance) -> int | None:
    """Why a change of the station's state stops the line.

    Args:
        before: the state before the change.
        after: the state after the change.

    Returns:
        A key of `STOP_REASONS`, or another exit code; None if the change does not stop the line.
    """
    stops = {VisionState.ERROR, VisionState.HALTED, VisionState.PREOPERATIONAL}
    left, entered = view(before).state, view(after).state
    if entered not in stops or left is entered or left is VisionState.ERROR:
        return None
    if entered is VisionState.PREOPERATIONAL:
        lost = Error.CONNECTION_LOST
        return lost.value if after.error_id == lost else 0
    answer = after.answer if entered is VisionState.ERROR else before.answer
    return answer.exit_code


class Job(NamedTuple):
    """An OPC UA client's request to locate one part."""

    number: int  # counts from 1 in this process
    id: str  # given by the server; no other job of this server has it
    meas_id: str  # given by the client
    recipe: str  # id of the recipe
    digest: str  # SHA-256 of the table's file
    configuration: str  # SHA-256 of the calibration's file; "" if nominal widths are used


class Result(NamedTuple):
    """The result of a job, as OPC UA clients see it; the pose is 0 if the part was not located."""

    ResultHandle: int  # number of the job
    ResultId: str  # id of the job
    MeasId: str
    RecipeId: str
    TableDigest: str
    ConfigurationDigest: str
    Outcome: str
    X_mm: float
    Y_mm: float
    Angle_deg: float
    ExpectedError_mm: float  # median error of the trials at this leaf; NaN if unknown
    ExpectedErrorP95_mm: float
    Part: str  # name of the part; "" if the table is for a single part
    Face: int  # 0 as drawn, 1 turned over
    ErrorId: int  # exit code of a fault, 0 otherwise
    ExitCode: int
    # From the part's first motion to its outcome, delivery included; NaN where this was not measured.
    Seconds: float


NO_RESULT = Result(0, "", "", "", "", "", OUTCOMES[0], 0.0, 0.0, 0.0, nan, nan, "", 0, 0, 0, nan)


def result_of(job: Job, parts: list[str], answer: Answer) -> Result:
    """Builds the result of a job.

    Args:
        job: the job.
        parts: names of the parts of the job's table; empty for a single part.
        answer: the part's result, in the units of the registers.
    """
    pose = answer.x / 1e3, answer.y / 1e3, answer.angle / 1e4
    errors, part = (nan, nan), ""
    if answer.outcome == 1:
        errors = _millimetres(answer.expected_error), _millimetres(answer.expected_error_p95)
        part = parts[answer.part] if parts else ""
    codes = answer.exit_code if answer.outcome == FAULT else 0, answer.exit_code
    outcome = OUTCOMES[answer.outcome]
    return Result(*job, outcome, *pose, *errors, part, answer.face, *codes, answer.seconds)


def _millimetres(error_um: int) -> float:
    return nan if error_um == UNKNOWN else error_um / 1e3
