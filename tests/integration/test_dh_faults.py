"""A DH gripper under every class of faults that can befall it: parts end as drivers/sim/FAULTS.md says."""

import pytest
from fault_classes import ROWS, allowed
from gripper_tables import table_for
from soaking import small_soak, soak_run

from drivers.sim.faults import KINDS, Channel, Fault, Listed
from runtime.execution.executor import RunOptions
from runtime.execution.handling import Handling

SEED, PART = 2, 1
HANDLED = (RunOptions(handling=Handling(regulated=True)),)
# It has no fault register, and another test of the arm and the scene than Robotiq's would be the same.
BEFALLS = [
    kind
    for kind in KINDS.values()
    if kind.channel in (Channel.LINE, Channel.GRIPPER) and not kind.name.startswith("gflt_")
]


def soak(*, faults, parts=1):
    return small_soak(parts, faults=faults, handled=HANDLED, table=table_for("dh-ag95"))


@pytest.fixture(scope="module")
def sound():
    return soak_run.run(soak(faults=False), SEED, Listed()).last


@pytest.mark.parametrize("kind", BEFALLS, ids=lambda kind: kind.name)
def test_part_that_meets_a_fault_ends_as_its_class_says(kind, sound):
    met = 0
    ways = [(length, value) for length in {1, kind.lasts} for value in {kind.low, kind.high}]
    for turn, at in enumerate(range(4, 150, 11)):
        length, value = ways[turn % len(ways)]
        fault = Fault(kind.name, PART, at, length, value)
        counts = soak_run.run(soak(faults=True), SEED, Listed([fault]))
        assert counts.findings == [], fault
        if counts.met:
            met += 1
            assert allowed(ROWS[kind.name][1], counts.last, sound), (fault, counts.last)
    assert met > 1


def test_run_of_random_faults_moves_nothing_without_a_look():
    for seed in range(12):
        assert soak_run.run(soak(faults=True, parts=8), seed).findings == []
