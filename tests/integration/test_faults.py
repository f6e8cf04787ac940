"""Every class of faults ends as drivers/sim/FAULTS.md says, whenever in a part's life it strikes."""

from itertools import product

import pytest
from fault_classes import ROWS, allowed
from soaking import small_soak, soak_run

from drivers.sim.faults import KINDS, Channel, Fault, Listed
from runtime.execution.executor import RunOptions
from runtime.execution.handling import Handling

SEED, PART = 2, 1  # this part takes both squeezes of the table, and reaches leaf 1
MOMENTS = {
    Channel.LINE: range(116),
    Channel.GRIPPER: range(116),
    Channel.ARM: range(14),
    Channel.SCENE: range(2),
}
SAMPLED = {Channel.LINE, Channel.GRIPPER}
EVERY = 8  # moments of the sampled channels
FINE = {"reply_late", "flag_late"}  # their values are seconds


HANDLED = {"direct": (RunOptions(),), "regulated": (RunOptions(handling=Handling(regulated=True)),)}
FIRST = {
    "direct": 0,
    "regulated": EVERY // 2,
}  # so that the moments of one lie between those of the other


@pytest.fixture(scope="module", params=HANDLED)
def handling(request):
    return request.param


@pytest.fixture(scope="module")
def handled(handling):
    return HANDLED[handling]


@pytest.fixture(scope="module")
def sound(handled):
    """How the part ends when nothing goes wrong."""
    return soak_run.run(small_soak(handled=handled), SEED, Listed()).last


def faults(kind, handling, every_moment):
    """Faults of a kind; unless at every moment, the values and lengths take turns from moment to moment."""
    values = {kind.low, (kind.low + kind.high) / 2, kind.high}
    if kind.name not in FINE:
        values = {round(value) for value in values}
    ways = list(product(sorted({1, kind.lasts}), sorted(values)))
    moments = MOMENTS[kind.channel]
    if kind.channel in SAMPLED and not every_moment:
        moments = moments[FIRST[handling] :: EVERY]
    for turn, at in enumerate(moments, FIRST[handling]):
        some = (
            ways
            if every_moment
            else (ways[turn % len(ways)], ways[turn % len(ways) - len(ways) // 2])
        )
        for length, value in dict.fromkeys(some):
            yield Fault(kind.name, PART, at, length, value)


def test_every_class_has_a_row_that_tells_what_it_means():
    assert set(ROWS) == set(KINDS)
    assert {name: row[0] for name, row in ROWS.items()} == {
        k.name: k.meaning for k in KINDS.values()
    }
    assert len(KINDS) >= 24


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.name)
def test_class(kind, handling, handled, sound, pytestconfig):
    outcomes, met = ROWS[kind.name][1], 0
    for fault in faults(kind, handling, pytestconfig.getoption("--every-moment")):
        counts = soak_run.run(small_soak(faults=True, handled=handled), SEED, Listed([fault]))
        assert counts.findings == [], fault
        if not counts.met:
            assert (counts.last.outcome, counts.last.leaf) == (sound.outcome, sound.leaf), fault
            continue
        met += 1
        assert allowed(outcomes, counts.last, sound), (fault, counts.last)
    assert met > 1
