"""A SCHUNK gripper under each class of faults that can befall it: parts end as drivers/sim/FAULTS.md says."""

import pytest
from fault_classes import ROWS, allowed
from gripper_tables import table_for
from soaking import small_soak, soak_run

from drivers.sim.faults import KINDS, Channel, Fault, Listed
from runtime.execution.executor import RunOptions
from runtime.execution.handling import Handling

SEED, PART = 2, 1
HANDLED = (RunOptions(handling=Handling(regulated=True)),)
# It has neither Robotiq's lesser faults nor an automatic release.
NONE_OF_ITS = {"gflt_05", "gflt_07", "gflt_08", "gflt_09", "gflt_0b", "gflt_0f"}
BEFALLS = [
    kind
    for kind in KINDS.values()
    if kind.channel in (Channel.LINE, Channel.GRIPPER) and kind.name not in NONE_OF_ITS
]


def soak(*, faults, parts=1):
    return small_soak(parts, faults=faults, handled=HANDLED, table=table_for("schunk-egu"))


@pytest.fixture(scope="module")
def sound():
    return soak_run.run(soak(faults=False), SEED, Listed()).last


@pytest.mark.parametrize("kind", BEFALLS, ids=lambda kind: kind.name)
def test_part_that_meets_a_fault_ends_as_its_class_says(kind, sound):
    met, outcomes = 0, ROWS[kind.name][1]
    if kind.name == "request_lost":  # four in a row are a silence that the gripper does not bear
        outcomes += ", fault 20"
    ways = [(length, value) for length in {1, kind.lasts} for value in {kind.low, kind.high}]
    for turn, at in enumerate(range(12, 260, 31)):
        length, value = ways[turn % len(ways)]
        fault = Fault(kind.name, PART, at, length, value)
        counts = soak_run.run(soak(faults=True), SEED, Listed([fault]))
        assert counts.findings == [], fault
        if counts.met:
            met += 1
            assert allowed(outcomes, counts.last, sound), (fault, counts.last)
    assert met > 1


def test_run_of_random_faults_moves_nothing_without_a_look():
    for seed in range(6):
        assert soak_run.run(soak(faults=True, parts=6), seed).findings == []
