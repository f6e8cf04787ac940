"""Results of the executor: one `Step` a squeeze, one `PartResult` a part."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple, Self

from runtime.shell.exit_codes import ExitCode
from runtime.table import Leaf, Phases, Squeeze, Table, turned_leaf


class Outcome(Enum):
    """Outcome of a part. The value is its name in the journal and in `--json`."""

    LEAF = "leaf"
    REJECT = "reject"
    UNRESOLVED = "unresolved"
    FAULT = "fault"
    STOPPED = "stopped"
    ABORTED = "aborted"


# Exit codes of the outcomes that are not faults; a fault has its own.
EXIT_CODES = {
    Outcome.LEAF: ExitCode.DONE,
    Outcome.REJECT: ExitCode.NOT_LOCATED,
    Outcome.UNRESOLVED: ExitCode.NOT_LOCATED,
    Outcome.STOPPED: ExitCode.STOPPED,
    Outcome.ABORTED: ExitCode.JOURNAL,
}


class Step(NamedTuple):
    """One squeeze and its reading."""

    number: int  # number of the squeeze, from 1, within the part
    node: int  # index of the node
    squeeze: Squeeze  # command
    reading_um: int  # settled width as the gripper reads it
    width_um: int  # true width
    target: int | None  # >= 0 the next node, < 0 leaf ~target, None for REJECT
    reason: str | None  # why the reading was rejected, or None

    def fields(self) -> dict[str, object]:
        """The step as fields of a journal record; of the squeeze only place and opening are included."""
        fields = self._asdict()
        squeeze = fields.pop("squeeze")
        names = ("x_um", "y_um", "angle_urad", "opening_um")
        place = {name: getattr(squeeze, name) for name in names}
        return {"number": self.number, "node": self.node, **place, **fields}


@dataclass(frozen=True, slots=True)
class PartResult:
    """Result of one part."""

    part: int  # number of the part
    outcome: Outcome  # the outcome
    steps: tuple[Step, ...]  # squeezes of the part, in order
    leaf: int | None  # index of the leaf reached, also if its delivery failed; or None
    reason: str | None  # why the part did not end in a resolved leaf, or None
    exit_code: int  # exit code of a run with this part only
    # results of the safe sequence, one sentence a step; empty without a fault
    safe_state: tuple[str, ...] = ()
    audit: str | None = None  # the audit's verdict: "pass", "fail" or "unknown"; None without
    delivery: str | None = None  # "done" or "missed", None without a delivery
    # seconds from the part's first motion to its outcome, with the delivery; None where not measured
    seconds: float | None = None
    # phases of each squeeze; where the part was resumed after a crash, only of the squeezes since
    phases: tuple[Phases, ...] = ()
    turn_urad: int = 0  # angle by which the part's plan was turned about the origin

    @classmethod
    def of(cls, part: int, outcome: Outcome, steps: Sequence[Step], reason: str | None) -> Self:
        """Builds the result of a part; the leaf is the target of the last step."""
        leaf = None
        if outcome in (Outcome.LEAF, Outcome.UNRESOLVED) and steps and steps[-1].target is not None:
            leaf = ~steps[-1].target
        code = EXIT_CODES.get(outcome, ExitCode.DEVICE)
        return cls(part, outcome, tuple(steps), leaf, reason, code)

    def leaf_of(self, table: Table) -> Leaf | None:
        """The leaf that was reached, turned with the part's plan; None if no leaf was reached."""
        return None if self.leaf is None else turned_leaf(table.leaves[self.leaf], self.turn_urad)

    def delivered(self, missed: str | None) -> Self:
        """The result after a delivery; `missed` states why the part was not put down, None if it was."""
        if missed is None:
            return replace(self, delivery="done")
        return replace(self, delivery="missed", reason=missed, exit_code=ExitCode.NOT_LOCATED)

    def fields(self) -> dict[str, object]:
        """The result as fields of a journal record."""
        return {
            "part": self.part,
            "outcome": self.outcome.value,
            "leaf": self.leaf,
            "path": [step.node for step in self.steps],
            "reason": self.reason,
            "exit_code": self.exit_code,
            "safe_state": list(self.safe_state),
            "audit": self.audit,
            "delivery": self.delivery,
            "seconds": None if self.seconds is None else round(self.seconds, 4),
            "phases": [
                {name: round(value, 4) for name, value in phases._asdict().items()}
                for phases in self.phases
            ],
        }
