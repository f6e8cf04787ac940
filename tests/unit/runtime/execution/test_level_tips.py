"""The tips keep their height while the jaws move."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from counting import width_um
from fake_cell import fake_cell
from refusals import refusal
from sample_tables import changed, small_table, with_job
from squeezes import ARC, AT_21, AT_36, AT_60, CLOSED, arm_moves, jaw_moves, meeting, run

from runtime.errors import TableError
from runtime.execution.executor import RunOptions
from runtime.execution.hand import Hand
from runtime.execution.handling import Handling
from runtime.execution.tips import TipArc
from runtime.traversal.results import Outcome


@pytest.mark.parametrize(
    ("regulated", "arc", "stop"),
    [
        (False, ARC, AT_21),
        (True, ARC, AT_21),
        (False, replace(ARC, level_mm=0.25), AT_36),  # so level that opening takes stages too
        (True, replace(ARC, level_mm=0.25), AT_60),
        (False, ARC, CLOSED),
        (True, ARC, CLOSED),
    ],
)
def test_executor_level_tips_stay_at_height_while_jaws_move(regulated, arc, stop):
    rig = meeting(stop[0])
    result = run(rig, RunOptions(handling=Handling(regulated=regulated, arc=arc)))
    assert result.outcome is (Outcome.LEAF if stop == AT_21 else Outcome.REJECT)
    low_mm, width_mm, tips = 10.0, 0.0, []
    z_mm, down = 30.0, False
    for call in rig.log.calls:
        if call.name == "move_linear":
            z_mm = call.arguments[2]
            down = down or (z_mm < 30.0)
        elif call.name == "move" and down and z_mm < 30.0:
            start_mm, count = width_mm, call.arguments[0]
            width_mm = width_um(min(count, stop[0])) / 1000
            # The last opening is not followed: the tips draw back.
            ways = range(21) if abs(width_mm - 85.0) > 1.0 else ()
            widths = (start_mm + (width_mm - start_mm) * k / 20 for k in ways)
            tips += [z_mm - arc.advance_mm(width) for width in widths]
        elif call.name == "move":
            width_mm = width_um(max(call.arguments[0], 3)) / 1000
    targets = arm_moves(rig)
    assert all(math.dist(before[:3], after[:3]) > 0.05 for before, after in pairwise(targets))
    assert tips
    assert low_mm - 0.1 <= min(tips) <= max(tips) <= low_mm + arc.level_mm + 0.15


def test_hand_with_tip_arc_regrasps_above_part_at_any_opening():
    rig, table = fake_cell([]), with_job(small_table(), '{"part":{"height_mm":16.0}}')
    straight, arced = (
        Hand(rig.gripper, rig.arm, rig.cell.clock, table, Handling(arc=arc)).timing.regrasp_mm
        for arc in (None, ARC)
    )
    assert straight == 20.0
    assert arced <= table.limits.retreat_height_um / 1000
    for width_mm in range(86):
        assert arced - ARC.advance_mm(width_mm) >= straight


@pytest.mark.parametrize(
    ("arc", "retreat_um", "said", "allowed"),
    [
        # Half of 85 mm less the offset is as long as the link: the arc has no height left there.
        (TipArc(link_mm=30.0, offset_mm=2.5), 200_000, "check link and offset", False),
        (TipArc(link_mm=40.0, offset_mm=2.5), 200_000, "check link and offset", False),
        (TipArc(link_mm=40.01, offset_mm=2.5), 200_000, "", True),
        # The tips advance by 30 mm at 85 mm of width and by 50 at 5, the arc's top.
        (TipArc(link_mm=50.0, offset_mm=2.5), 30_000, "takes the arm up to 30.0 mm", False),
        (TipArc(link_mm=50.0, offset_mm=2.5), 30_001, "", True),
        (TipArc(taught_mm=79.99), 60_000, "taught at 79.99 mm and the jaws open to 85 mm", False),
        (TipArc(taught_mm=80.0), 60_000, "", True),
    ],
)
def test_hand_with_impossible_tip_arc_is_refused(arc, retreat_um, said, allowed):
    rig = fake_cell([])
    table = changed(small_table(), {"limits.retreat_height_um": retreat_um})
    with refusal(TableError, said, unless=allowed):
        Hand(rig.gripper, rig.arm, rig.cell.clock, table, Handling(arc=arc))


def test_executor_contact_while_opening_is_fault_without_force():
    rig = fake_cell([(AT_21[0], 1)])
    result = run(rig, RunOptions(handling=Handling(regulated=True)))
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, 20)
    assert "contact while opening" in str(result.reason)
    assert [force for position, _, force in jaw_moves(rig) if position > 0] == [0]


def test_executor_arm_follows_tips_not_below_squeeze_height():
    """The tips' height is taught at 80 mm of opening; at 85 mm, the tips are 2 mm higher."""
    rig = meeting(AT_21[0])
    assert run(rig, RunOptions(handling=Handling(arc=TipArc(taught_mm=80.0)))).leaf == 0
    assert min(target[2] for target in arm_moves(rig)) == 10.0
