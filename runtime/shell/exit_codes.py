"""Exit codes of all commands, each with a sentence about the remedy."""

from enum import IntEnum


class ExitCode(IntEnum):
    """Exit code of a command. A higher code is more severe; a run ends with the code of its worst part."""

    sentence: str  # what the code means, and what to do

    def __new__(cls, value: int, sentence: str) -> "ExitCode":
        """Creates an exit code with its sentence."""
        code = int.__new__(cls, value)
        code._value_ = value
        code.sentence = sentence
        return code

    DONE = 0, "done; every result is within the goal"
    INTERNAL = 1, "internal error: report it, with the output of --debug"
    USAGE = 2, "the command line is wrong or an output cannot be written: correct it"
    INPUT = 3, "an input file is missing or refused: correct the file"
    NO_PLAN = 4, "no plan reaches the goal: change the job"
    NOT_LOCATED = 10, "a part was rejected, unresolved or not delivered: feed it again"
    CHECK_FAILED = 11, "a check failed, a chart alarms or a study refuses: read the report"
    UNDECIDED = 12, "a study is not decided yet: run more parts"
    DEVICE = 20, "the gripper, the arm or the camera reports a fault: look at the cell"
    UNREACHABLE = 21, "a device, cell or cluster cannot be reached or is in use: connect it"
    JOURNAL = 24, "the journal fails, or its last run broke off: see --after-crash"
    SIGNATURE = 34, "a pack was changed, or no trusted key signed it: ask who signs"
    STOPPED = 40, "the operator stopped the command; the fingers were stopped"
    INTERRUPTED = 130, "interrupted; no half-written file is left"


def epilog(*codes: ExitCode) -> str:
    """Builds the section of --help that explains a command's exit codes.

    Args:
        codes: the codes to list besides 0, 1, 2 and the code after Ctrl-C.
    """
    end = set() if ExitCode.STOPPED in codes else {ExitCode.INTERRUPTED}
    listed = sorted({ExitCode.DONE, ExitCode.INTERNAL, ExitCode.USAGE, *codes} | end)
    return "\n".join(["exit codes:", *(f"  {code:>3}  {code.sentence}" for code in listed), ""])
