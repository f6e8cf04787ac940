"""A part with a fault of any class, at any moment, ends as drivers/sim/FAULTS.md states."""

import re
from functools import cache
from itertools import product
from typing import NamedTuple

import pytest
from programs import ROOT
from sample_tables import table_for
from soaking import small_soak, soak_run

from drivers.sim.faults import KINDS, Channel, Fault, Listed
from runtime.execution.executor import RunOptions
from runtime.execution.handling import Handling
from runtime.table import Table
from runtime.traversal.results import PartResult

FAULTS = (ROOT / "drivers" / "sim" / "FAULTS.md").read_text()
ROWS = {
    name: [cell.strip() for cell in rest.split("|")]
    for name, rest in re.findall(r"^\| `(\w+)` \|(.+)\|$", FAULTS, re.MULTILINE)
}
DECIDED = {"leaf", "unresolved", "reject"}
SEED, PART = 2, 1  # this part takes both squeezes of the table, and reaches leaf 1
DEVICE = {Channel.LINE, Channel.GRIPPER}
IN_SECONDS = {"reply_late", "flag_late"}  # their values are seconds
REGULATED = RunOptions(handling=Handling(regulated=True))


class Cell(NamedTuple):
    """A gripper, and how parts are handled with it.

    Attributes:
        table: the gripper's table; None: the small table.
        moments: the moments of a part at which faults of the line and the gripper occur.
        spared: fault classes that the gripper does not have, or that concern arm and scene alone.
    """

    table: Table | None
    options: RunOptions
    moments: range
    spared: frozenset[str] = frozenset()


OTHERS = frozenset(kind.name for kind in KINDS.values() if kind.channel not in DEVICE)
CELLS = {
    # The moments of these two cells interleave.
    "direct": Cell(None, RunOptions(), range(0, 116, 24)),
    "regulated": Cell(None, REGULATED, range(12, 116, 24)),
    "dh-ag95": Cell(
        table_for("dh-ag95"),
        REGULATED,
        range(4, 150, 11),
        # This gripper has no fault register.
        OTHERS | {name for name in KINDS if name.startswith("gflt_")},
    ),
    "schunk-egu": Cell(
        table_for("schunk-egu"),
        REGULATED,
        range(12, 260, 31),
        # This gripper has neither Robotiq's lesser faults nor an automatic release.
        OTHERS | {f"gflt_{code}" for code in ("05", "07", "09", "0b", "0f")},
    ),
}
CASES = [(cell, KINDS[name]) for cell in CELLS for name in KINDS if name not in CELLS[cell].spared]


def run(cell: Cell, faults: Listed, *, faulty: bool) -> object:
    soak = small_soak(faults=faulty, handled=(cell.options,), table=cell.table)
    return soak_run.run(soak, SEED, faults)


def allowed(outcomes: str, result: PartResult, sound: PartResult) -> bool:
    """Whether a part ended in one of the `outcomes` that FAULTS.md lists for its fault.

    The outcome "same" is that of `sound`, the same part without a fault; "decided" is any of `DECIDED`.
    """
    how = result.outcome.value
    ends = {how, f"{how} {result.exit_code}"}
    ends |= {"same"} if (result.outcome, result.leaf) == (sound.outcome, sound.leaf) else set()
    ends |= {"decided"} if how in DECIDED else set()
    return not ends.isdisjoint(outcomes.split(", "))


@cache
def sound(name: str) -> object:
    """The result of the part in a cell without faults."""
    return run(CELLS[name], Listed(), faulty=False).last


def faults(kind, cell, every_moment):
    """Yields faults of a kind, one or two at each moment; their values and lengths alternate.

    With `every_moment`, every value and length occurs at every moment. Faults of the line and the gripper
    occur at the moments of the cell, other faults at moments of their own.
    """
    values = {kind.low, (kind.low + kind.high) / 2, kind.high}
    if kind.name not in IN_SECONDS:
        values = {round(value) for value in values}
    if cell.table:
        values = {kind.low, kind.high}
    ways = list(product(sorted({1, kind.lasts}), sorted(values)))
    moments = cell.moments
    if kind.channel not in DEVICE:
        moments = range(14 if kind.channel is Channel.ARM else 2)
    elif every_moment:
        moments = range(moments.stop)
    for turn, at in enumerate(moments):
        some = [ways[turn % len(ways)]]
        if not cell.table:
            some.append(ways[turn % len(ways) - len(ways) // 2])
        for length, value in dict.fromkeys(ways if every_moment else some):
            yield Fault(kind.name, PART, at, length, value)


def test_faults_page_has_row_with_meaning_of_each_class():
    rows = {name: row[0] for name, row in ROWS.items()}
    assert rows == {kind.name: kind.meaning for kind in KINDS.values()}
    assert len(KINDS) >= 24


@pytest.mark.parametrize(("name", "kind"), CASES, ids=lambda case: getattr(case, "name", case))
def test_soak_run_part_with_fault_ends_as_faults_page_states(name, kind, pytestconfig):
    outcomes, met, cell = ROWS[kind.name][1], 0, CELLS[name]
    if (name, kind.name) == ("schunk-egu", "request_lost"):
        outcomes += ", fault 20"  # this gripper does not tolerate the silence of four lost requests
    for fault in faults(kind, cell, pytestconfig.getoption("--every-moment")):
        counts = run(cell, Listed([fault]), faulty=True)
        assert counts.findings == [], fault
        if not counts.met:
            ended = counts.last.outcome, counts.last.leaf
            assert ended == (sound(name).outcome, sound(name).leaf), fault
            continue
        met += 1
        assert allowed(outcomes, counts.last, sound(name)), (fault, counts.last)
    assert met > 1


@pytest.mark.parametrize("name", ["dh-ag95", "schunk-egu"])
def test_soak_run_other_make_under_random_faults_has_no_findings(name):
    for seed in range(6):
        soak = small_soak(6, faults=True, handled=(REGULATED,), table=CELLS[name].table)
        assert soak_run.run(soak, seed).findings == []
