"""Decides by a policy (abort, resume, restart) what becomes of a run that broke off; opens no device."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from runtime.devices.clock import age_s
from runtime.errors import BrokenRunError
from runtime.execution.events import Console
from runtime.execution.recovery import ABORT_REMEDY
from runtime.journal.chain import Journal
from runtime.journal.lines import Entry
from runtime.journal.replay import Last, Replay
from runtime.shell import interrupts
from runtime.shell.exit_codes import ExitCode
from runtime.traversal.decision import TraversalState
from runtime.traversal.results import Outcome, PartResult

ABORT, RESUME, RESTART = "abort", "resume", "restart"
GIVEN_UP = {"exit_code": ExitCode.JOURNAL, "reason": "given up after a crash"}
# Fields of the header that must be the same in a resumed run, and what messages call them.
SAME = {
    "table_sha256": "table",
    "calibration_um": "calibration",
    "middle_um": "middle of the fingers",
    "on_reject": "--on-reject",
    "on_unresolved": "--on-unresolved",
    "delivery": "--deliver",
}


def look(
    journal: Journal, fields: Mapping[str, object], policy: str, console: Console, most_s: float
) -> Replay | None:
    """Checks whether a journal's last run broke off; gives such a run up, or returns it to be continued.

    With the policy `ABORT` the run is given up: this is journalled, and an error is raised. With `RESUME` and
    `RESTART` nothing is journalled; with `RESTART` the returned run begins its part again.

    Args:
        journal: the open journal, without an incomplete last line.
        fields: the header of a new run, with `table_sha256`.
        policy: `ABORT`, `RESUME` or `RESTART`.
        console: receives a message if a run is to be continued.
        most_s: greatest age, s, of the last record, for a run that broke off within a part.

    Returns:
        The run to continue; None where the last run ended.

    Raises:
        BrokenRunError: the run was given up, or cannot be continued: a field of `SAME` differs, a replay
            contradicts its records, its last record is too old or of unknown age, or it is to be resumed at a
            part that was being pushed.
    """
    try:
        broken = broken_run(journal.path, journal.last_part)
    except BrokenRunError:
        if policy == ABORT:
            interrupts.conclude()
            journal.record("end", GIVEN_UP)
        raise
    if broken is None:
        return None
    message = f"the last run in {journal.path} broke off {_where(broken)}"
    if policy == ABORT:
        interrupts.conclude()  # so that the run is given up in the journal and on the console, or in neither
        _give_up(journal, broken)
        raise BrokenRunError(
            f"{message}; it is given up and nothing was moved: "
            "look at the fingers, clear the cell, start again"
        )
    for name, what in SAME.items():
        if (broken.header.get(name) or None) != (fields.get(name) or None):
            raise BrokenRunError(
                f"the run that broke off had another {what}; start with that one, or with --after-crash abort"
            )
    if broken.last is Last.PUSHING and policy == RESUME:
        raise BrokenRunError(
            f"{message}, while the part was pushed, and nobody knows where it lies; start with --after-crash "
            f"{RESTART}, which begins with that part again, or with --after-crash {ABORT}"
        )
    if broken.part is not None:
        _check_recent(journal.last_part[-1], journal.now(), most_s)
    goes_on = "going on with it" if policy == RESUME else "starting that part over"
    console.note(f"{message}; {goes_on}")
    if policy == RESTART:  # from the root; the record of what the hand may hold is kept
        broken.traversal, broken.steps = TraversalState(), []
    return broken


def begin(
    journal: Journal, broken: Replay | None, table: bytes, fields: Mapping[str, object], policy: str
) -> None:
    """Writes the first record of a new run (`header`), or of the continuation of a broken run (`resume`).

    Args:
        journal: the journal.
        broken: the run that broke off; None: a new run begins.
        table: the bytes of the table's file, for the header.
        fields: the other fields of the header.
        policy: how the run continues: `RESUME` or `RESTART`.

    Raises:
        JournalError: the journal cannot be written.
    """
    cut = {"cut_bytes": journal.cut_bytes} if journal.cut_bytes else {}
    if broken is None:
        journal.header(table, {**fields, **cut})
    else:
        journal.record("resume", {"part": broken.part, "how": policy, **cut})


def broken_run(path: Path, entries: Iterable[Entry]) -> Replay | None:
    """Returns the last run of a journal if it broke off; None if it ended.

    Args:
        path: path of the journal, for messages.
        entries: all records of the journal, or only those that matter here (`Journal.last_part`).

    Raises:
        BrokenRunError: the run broke off, and a replay contradicts its records.
    """
    replay = Replay()
    findings = list(replay.follow(entries))
    if replay.closed or replay.over:
        return None
    if findings:
        raise BrokenRunError(
            f"journal {path}, record {findings[-1].seq}: {findings[-1].sentence}; "
            "a run that cannot be followed is not resumed: clear the cell and use --after-crash abort"
        )
    return replay


def _check_recent(last: Entry, now: Entry, most_s: float) -> None:
    """Checks that a part's last record is at most `most_s` old, so that the same part still lies there.

    Raises:
        BrokenRunError: the record is older, or its age is unknown.
    """
    written = f"the run that broke off wrote its last record at {last['time']}"
    passed_s = age_s(last, now)
    if passed_s is None:
        raise BrokenRunError(
            f"{written}, and the clock says {now.get('time')}: how long ago that is, is not clear (another "
            f"boot, a clock that went back, or a record without `boot` and `up_s`); {ABORT_REMEDY}"
        )
    if passed_s > most_s:
        raise BrokenRunError(
            f"{written}, {passed_s:.0f} s ago; after {most_s:g} s (--resume-within) the part may be another: "
            f"{ABORT_REMEDY}"
        )


def _give_up(journal: Journal, broken: Replay) -> None:
    if broken.part is not None:
        result = PartResult.of(broken.part, Outcome.ABORTED, broken.steps, "the run broke off")
        journal.record("outcome", {**result.fields(), "safe_state": ["nothing was moved"]})
    journal.record("end", GIVEN_UP)


def _where(broken: Replay) -> str:
    if broken.part is None:
        return f"after {broken.parts} parts"
    squeezes = len(broken.steps)
    return f"at part {broken.part}, after {squeezes} squeeze{'' if squeezes == 1 else 's'}"
