"""Applies the declared policy to a run that broke off, before any device is opened."""

import hashlib
from collections.abc import Mapping

from runtime.errors import BrokenRunError
from runtime.execution.events import Console
from runtime.execution.recovery import BrokenRun, broken_run, check_recent, restarted
from runtime.journal.chain import Journal
from runtime.shell import interrupts
from runtime.traversal.results import Outcome, PartResult

ABORT, RESUME, RESTART = "abort", "resume", "restart"


def look(
    journal: Journal,
    table: bytes,
    fields: Mapping[str, object],
    policy: str,
    console: Console,
    *,
    now: str,
    most_s: float,
) -> BrokenRun | None:
    """Look for a run that broke off, and give it up if that is the policy; nothing else is written.

    Args:
        journal: open; what a crash cut short is cut off.
        table: the table's bytes.
        fields: what the header of a new run would tell.
        policy: `ABORT`, `RESUME` or `RESTART`.
        console: told what was found.
        now: what a record would be dated with now.
        most_s: age of the last record from which on a part is not gone on with, s.

    Returns:
        What can be gone on with, None where the last run ended.

    Raises:
        BrokenRunError: the policy is to give it up, or it cannot be gone on with: another table, another
            calibration, a record that its counts do not justify, or too old a part.
        JournalError: the journal cannot be written.
    """
    broken = _found(journal, policy)
    if broken is None:
        return None
    told = f"the last run in {journal.path} broke off {_where(broken)}"
    if policy == ABORT:
        interrupts.conclude()  # given up in the journal and told so, or neither
        _give_up(journal, broken)
        raise BrokenRunError(
            f"{told}; it is given up and nothing was moved: look at the fingers, clear the cell, start again"
        )
    _check_same(broken, table, fields)
    if broken.part is not None:
        check_recent(broken, now, most_s)
    console.note(f"{told}; {'going on with it' if policy == RESUME else 'starting that part over'}")
    if policy == RESTART and broken.part is not None:
        return broken._replace(part=restarted(broken.part))
    return broken


def begin(
    journal: Journal, broken: BrokenRun | None, table: bytes, fields: Mapping[str, object], policy: str
) -> None:
    """Write a new run's header, or that the broken one is gone on with.

    Raises:
        JournalError: the journal cannot be written.
    """
    cut = {"cut_bytes": journal.cut_bytes} if journal.cut_bytes else {}
    if broken is None:
        journal.header(table, {**fields, **cut})
        return
    part = None if broken.part is None else broken.part.part
    journal.record("resume", {"part": part, "how": policy, **cut})


def _found(journal: Journal, policy: str) -> BrokenRun | None:
    try:
        return broken_run(journal.path)
    except BrokenRunError:
        if policy != ABORT:
            raise
        interrupts.conclude()
        journal.record("end", {"exit_code": BrokenRunError.exit_code, "reason": "given up after a crash"})
        raise


def _give_up(journal: Journal, broken: BrokenRun) -> None:
    code = BrokenRunError.exit_code
    if broken.part is not None:
        result = PartResult.of(
            broken.part.part,
            Outcome.ABORTED,
            broken.part.steps,
            "the run broke off",
            safe_state=("nothing was moved",),
        )
        journal.record("outcome", result.fields())
    journal.record("end", {"exit_code": code, "reason": "given up after a crash"})


def _check_same(broken: BrokenRun, table: bytes, fields: Mapping[str, object]) -> None:
    """Check that the run is gone on with as it was begun."""
    now = {**fields, "table_sha256": hashlib.sha256(table).hexdigest()}
    named = {
        "table_sha256": "table",
        "widths_um": "calibration",
        "on_reject": "--on-reject",
        "on_unresolved": "--on-unresolved",
    }
    for name, what in named.items():
        if broken.header.get(name) != now.get(name):
            raise BrokenRunError(
                f"the run that broke off had another {what}; start with that one, or with --after-crash abort"
            )


def _where(broken: BrokenRun) -> str:
    if broken.part is None:
        return f"after {broken.parts} parts"
    squeezes = len(broken.part.steps)
    return f"at part {broken.part.part}, after {squeezes} squeeze{'' if squeezes == 1 else 's'}"
