"""Views of a station for a line's supervisor: states of OPC 40100-1 and of PackML, results, stop reasons.

The module makes no decisions: the handshake accepts events and determines what follows. `tools/docs/plc.md`
shows `VIEW`. The module does not use OPC UA.
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
    """States of the machine vision companion specification (OPC 40100-1); values are its names."""

    PREOPERATIONAL = "Preoperational"
    HALTED = "Halted"
    ERROR = "Error"
    INITIALIZED = "Initialized"
    READY = "Ready"
    SINGLE_EXECUTION = "SingleExecution"

    @property
    def automatic(self) -> bool:
        """Whether the state is part of the automatic mode, within the state Operational."""
        return self in _AUTOMATIC

    @property
    def outer(self) -> str:
        """Name of the state in the specification's top-level state machine."""
        return "Operational" if self.automatic else self.value


_AUTOMATIC = {VisionState.INITIALIZED, VisionState.READY, VisionState.SINGLE_EXECUTION}


class PackMLState(IntEnum):
    """The PackML states (ISA-TR88.00.02) in use."""

    STOPPED = 2
    IDLE = 4
    EXECUTE = 6
    ABORTED = 9
    COMPLETE = 17


class Row(NamedTuple):
    """A row of `VIEW`: a state of each of the two standards, and the condition for showing both."""

    state: VisionState
    packml: PackMLState
    when: str  # in the words of the documentation
    holds: Callable[[Glance], bool]


def waits(seen: Glance) -> bool:
    """Whether a result waits for the PLC to take it."""
    return SIGNALS[seen.state].result_valid


def _failed(seen: Glance) -> bool:
    return waits(seen) and seen.answer.outcome == FAULT


def _works(seen: Glance) -> bool:
    return SIGNALS[seen.state].busy


# The views of a station; the first row whose condition holds is shown.
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
    """Why the station's change from `before` to `after` stops the line; None if it does not stop it.

    A reason is a key of `STOP_REASONS` or another exit code.
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
    """A requested part, with the names that server and client gave it."""

    number: int  # from 1, within this process
    id: str  # given by the server, unique over all its runs
    meas_id: str  # given by the client
    recipe: str
    digest: str  # SHA-256 of the table's file
    configuration: str  # SHA-256 of the calibration's file, "" for the linear map


class Result(NamedTuple):
    """A part's result: its job, and figures with units in their names; it has a pose only if located."""

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
    Part: str  # its name, "" for a single part
    Face: int  # 0 as drawn, 1 turned over
    ErrorId: int  # exit code of a fault, 0 otherwise
    ExitCode: int
    Seconds: float  # time from the part's first motion to its outcome; NaN where not measured


NO_RESULT = Result(0, "", "", "", "", "", OUTCOMES[0], 0.0, 0.0, 0.0, nan, nan, "", 0, 0, 0, nan)


def result_of(job: Job, parts: list[str], answer: Answer) -> Result:
    """The result of a job; `parts` are the names of its table's parts."""
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
