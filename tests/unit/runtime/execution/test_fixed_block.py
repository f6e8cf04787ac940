"""The point where the fingers meet: measured on a fixed block, and its effect on a table's places."""

import math
import random
from dataclasses import replace

import pytest
from asked import asked_parts
from fake_scene import setting
from sample_tables import small_table

from drivers.sim.physics.scene import Block
from drivers.sim.virtual.cell import VirtualCell
from runtime.errors import GripperStateError, MotionRefusedError
from runtime.execution import fixed_block
from runtime.execution.executor import RunOptions
from runtime.execution.fixed_block import Grip, fit, gripping, measure
from runtime.execution.hand import Hand
from runtime.execution.handling import Handling
from runtime.execution.safety import check_places
from runtime.shell.errors import InputError
from runtime.table import Area
from runtime.table.geometry import compose, placement, sent

BLOCK_MM, OPENING_MM = 30.0, 85.0


def stopped(hand_mm, share, block_mm=0.0, across_mm=0.0):
    """Slow reference version: the opening at which fingers that close stepwise first touch a block [mm].

    Args:
        hand_mm: position of the hand along the closing axis.
        share: the upper finger's share of the closing.
        block_mm: position of the block's middle along the closing axis.
        across_mm: offset of the middle between the open fingers from the hand.
    """
    upper = hand_mm + across_mm + OPENING_MM / 2.0
    lower = hand_mm + across_mm - OPENING_MM / 2.0
    step = 0.005
    while upper - lower > 0.0:
        upper, lower = upper - step * share, lower + step * (1.0 - share)
        if upper <= block_mm + BLOCK_MM / 2.0 or lower >= block_mm - BLOCK_MM / 2.0:
            return upper - lower
    return 0.0


def halves(share, across_mm, block_mm=1.3, read=lambda width: width):
    """Yields a position of the hand and grips near it, first for one orientation, then for the opposite one.

    At this position, both fingers meet the block at the same time. Positions are along the closing axis;
    the block is at `block_mm` in the first orientation. `read` turns an opening into a reading.
    """
    meet = across_mm + (0.5 - share) * (OPENING_MM - BLOCK_MM)
    for side in (1, -1):
        result = side * block_mm - meet
        offs = [result + way * off for off in fixed_block.FINE_MM for way in (-1, 1)]
        yield result, [Grip(h, read(stopped(h, share, side * block_mm, across_mm))) for h in offs]


@pytest.mark.parametrize(("share", "across_mm"), [(0.5, 0.0), (0.5, 1.5), (0.44, -0.8), (0.6, 2.0)])
def test_fit_exact_grips_gives_meeting_point_and_finger_share(share, across_mm):
    result = fit(BLOCK_MM, list(halves(share, across_mm)))
    assert result.share == pytest.approx(share, abs=1e-3)
    # With uneven fingers the middle depends on the width.
    for width_mm, near_mm in ((BLOCK_MM, 5e-3), (10.0, 0.03), (50.0, 0.03)):
        meet_mm = across_mm + (0.5 - share) * (OPENING_MM - width_mm)
        assert result.at(width_mm)[0] == pytest.approx(meet_mm, abs=near_mm)


def test_fit_errors_cover_effect_of_counts_and_noise():
    count_mm, draw, off = 85.0 / 227.0, random.Random(3), []
    for k in range(16):
        read = lambda width: count_mm * round((width + draw.gauss(0.0, 0.15)) / count_mm)  # noqa: E731
        result = fit(BLOCK_MM, list(halves(0.48, 0.9, 0.25 * k, read)))
        off.append((result.at(BLOCK_MM)[0] - 0.9 - 0.02 * 55.0) / result.across_error_mm)
        assert result.across_error_mm < 0.1
    assert 0.6 < math.sqrt(sum(z * z for z in off) / len(off)) < 1.5


def test_fit_grips_on_loose_or_wrong_block_are_refused():
    loose = [(0.0, [Grip(off, BLOCK_MM + 0.01 * k) for k, off in enumerate((-5.0, 5.0) * 6)])] * 2
    with pytest.raises(InputError, match="does not give way"):
        fit(BLOCK_MM, loose)
    with pytest.raises(InputError, match="look at its width"):
        fit(BLOCK_MM - 2.0, list(halves(0.5, 1.0)))
    with pytest.raises(InputError, match="set the tool frame"):
        fit(BLOCK_MM, list(halves(0.5, 12.0)))
    for block_mm in (0.0, -3.0, 56.0, math.nan):
        with pytest.raises((InputError, ValueError)):
            gripping(small_table(), block_mm)


STANDING = Block(BLOCK_MM, 12.0, -7.0)


class Rig:
    """A simulated cell with a fixed block in place of parts, and a hand that speaks the cell's protocols."""

    def __init__(self, block=STANDING, middle_mm=1.5):
        self.table = small_table()
        self.cell = VirtualCell(setting()._replace(block=block, middle_mm=middle_mm), 5)
        gripper, arm = self.cell.gripper(), self.cell.arm()
        gripper.activate()
        self.hand = Hand(gripper, arm, self.cell.clock, self.table, Handling())

    def measure(self, at, block_mm=BLOCK_MM):
        lines = []
        result = measure(self.hand, gripping(self.table, block_mm), block_mm, at, lines.append)
        assert len(lines) == 2
        return result


@pytest.mark.parametrize("angle", [0.0, math.pi / 2])
def test_measure_of_simulated_cell_equals_its_middle(angle):
    rig = Rig()
    result = rig.measure((11.0, -5.5, angle))
    assert abs(result.across_mm - 1.5) < 3.0 * result.across_error_mm
    assert result.across_error_mm < 0.1
    assert abs(result.share - 0.5) < 3.0 * result.share_error
    assert rig.cell.works.table.crashes == 0
    assert rig.hand.where()[2] == pytest.approx(rig.table.limits.retreat_height_um / 1000, abs=0.05)


@pytest.mark.parametrize(
    ("block", "middle_mm", "error", "message"),
    [
        (Block(BLOCK_MM, 0.0, 5.0), 0.0, InputError, r"about \+[45]\.. mm off"),
        (Block(BLOCK_MM - 8.0), 0.0, InputError, "hold it fast"),
        (Block(BLOCK_MM, 50.0), 1.5, GripperStateError, "met no block"),
    ],
    ids=["displaced", "another width", "missing"],
)
def test_measure_displaced_other_or_missing_block_is_refused(block, middle_mm, error, message):
    with pytest.raises(error, match=message):
        Rig(block, middle_mm).measure((0.0, 0.0, 0.0))


def test_check_places_outside_work_area_is_refused():
    table = small_table()
    check_places(table, 1.0)
    low_um = round(1000 * sent(placement(table.nodes[0].squeeze), 1.0)[1]) + 500
    tight = replace(table.limits, work_area_um=Area(-90_000, low_um, 90_000, 90_000))
    check_places(replace(table, limits=tight, nodes=table.nodes[:1]), 0.0)
    with pytest.raises(MotionRefusedError, match="outside the work area"):
        check_places(replace(table, limits=tight, nodes=table.nodes[:1]), 1.0)


def test_asked_parts_squeeze_place_includes_middle():
    lines = []
    for middle_mm in (0.0, 1.5):
        options = RunOptions(handling=Handling(middle_mm=middle_mm))
        asked = asked_parts(small_table(), options)
        asked.answer("NEXT")
        lines.append(asked.answer("WIDTH 30.0 OBJECT").split())
    at, beside = ([float(word) for word in words[2:5]] for words in lines)
    assert lines[0][:2] == lines[1][:2] == ["SQUEEZE", "1"]
    there = compose((beside[0], beside[1], math.radians(beside[2])), (0.0, 1.5, 0.0))
    assert there[:2] == pytest.approx(at[:2], abs=2e-3)
    assert lines[0][4:] == lines[1][4:]
