"""Journals that the runtime itself writes, for tests of commands that read journals."""

from pathlib import Path

from fake_cell import Deaf, fake_cell
from sample_tables import small_table
from squeezes import AT_21, AT_30, AT_36

from runtime.devices.clock import SystemClock
from runtime.execution import session
from runtime.execution.executor import Cell, RunOptions
from runtime.journal.chain import SEGMENT_BYTES, Journal, records, verify
from runtime.journal.replay import Replay
from runtime.table import Calibration, dumps
from runtime.traversal.decision import Policy

ENDS = ["leaf", "leaf", "unresolved", "reject"]


def write_run(
    path: Path,
    policy: Policy | None = None,
    calibration: Calibration | None = None,
    segment_bytes: int = SEGMENT_BYTES,
) -> Path:
    """Runs four parts on a fake cell, and records them in the journal at `path`; returns the path.

    The parts end at leaf 0, at leaf 1 after two squeezes, at the unresolved leaf 2, and with REJECT.
    """
    rig = fake_cell([AT_21, AT_30, AT_21, AT_30, AT_36, AT_36])
    policy = policy or Policy()
    table = small_table()
    with Journal(path, SystemClock().stamp, SystemClock().uptime, segment_bytes) as journal:
        fields: dict[str, object] = {**policy.fields(), "port": "memory"}
        if calibration is not None:
            fields["calibration_um"] = list(calibration.points_um)
        journal.header(dumps(table), fields)
        cell = Cell(rig.gripper, rig.arm, rig.cell.clock, journal)
        session.run_journalled(table, cell, Deaf(), RunOptions(policy, count=4))
    return path


def assert_sound(journal: Path) -> None:
    """Asserts that a journal verifies, has its last record, and that a replay derives the same decisions."""
    assert verify(journal).closed
    assert list(Replay().follow(records(journal))) == []
