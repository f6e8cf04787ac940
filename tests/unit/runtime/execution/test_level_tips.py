"""The tips keep their height while the jaws move."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from counting import width_um
from fake_cell import fake_cell
from sample_tables import LIMITS, small_table
from squeezes import ARC, AT_21, AT_36, AT_60, CLOSED, jaw_moves, meeting, run

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
        (False, replace(ARC, level_mm=0.25), AT_36),  # so level that letting go takes stages too
        (True, replace(ARC, level_mm=0.25), AT_60),
        (False, ARC, CLOSED),
        (True, ARC, CLOSED),
    ],
)
def test_level_tips_stay_at_their_height_while_the_jaws_move(regulated, arc, stop):
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
            tips += [
                z_mm - arc.advance_mm(start_mm + (width_mm - start_mm) * k / 20)
                for k in range(21)
                if abs(width_mm - 85.0)
                > 1.0  # the last opening is not followed: the tips draw back
            ]
        elif call.name == "move":
            width_mm = width_um(max(call.arguments[0], 3)) / 1000
    targets = [call.arguments[:4] for call in rig.log.named("move_linear")]
    assert all(math.dist(before[:3], after[:3]) > 0.05 for before, after in pairwise(targets))
    assert tips
    assert low_mm - 0.1 <= min(tips) <= max(tips) <= low_mm + arc.level_mm + 0.15


def test_an_arc_whose_links_would_lie_flat_is_refused():
    """Half of 85 mm less the offset is as long as the link: the arc has no height left there."""
    rig = fake_cell([])
    room = replace(small_table(), limits=replace(LIMITS, retreat_height_um=200_000))
    for link_mm, refused in ((30.0, True), (40.0, True), (40.01, False)):
        flat = Handling(arc=TipArc(link_mm=link_mm, offset_mm=2.5))
        if not refused:
            Hand(rig.gripper, rig.arm, rig.cell.clock, room, flat)
            continue
        with pytest.raises(TableError, match="check link and offset"):
            Hand(rig.gripper, rig.arm, rig.cell.clock, room, flat)


@pytest.mark.parametrize(("taught_mm", "refused"), [(79.99, True), (80.0, False), (85.0, False)])
def test_the_tool_frame_is_taught_with_the_jaws_open_or_nearly_so(taught_mm, refused):
    rig, taught = fake_cell([]), Handling(arc=TipArc(taught_mm=taught_mm))
    if not refused:
        Hand(rig.gripper, rig.arm, rig.cell.clock, small_table(), taught)
        return
    with pytest.raises(
        TableError, match=f"was taught at {taught_mm:g} mm and the jaws open to 85 mm"
    ):
        Hand(rig.gripper, rig.arm, rig.cell.clock, small_table(), taught)


def test_the_arc_s_top_lies_below_the_retreat_height():
    """Link 50, offset 2.5: the tips advance by 30 mm at 85 mm of width and by 50 at 5, the arc's top."""
    rig, arc = fake_cell([]), Handling(arc=TipArc(link_mm=50.0, offset_mm=2.5))
    for retreat_um, refused in ((30_000, True), (30_001, False)):
        limits = replace(LIMITS, squeeze_height_um=10_000, retreat_height_um=retreat_um)
        table = replace(small_table(), limits=limits)
        if not refused:
            Hand(rig.gripper, rig.arm, rig.cell.clock, table, arc)
            continue
        with pytest.raises(
            TableError, match=r"takes the arm up to 30.0 mm, the retreat height is 30 mm"
        ):
            Hand(rig.gripper, rig.arm, rig.cell.clock, table, arc)


def test_contact_while_opening_is_no_contact_to_squeeze_harder_on():
    rig = fake_cell([(AT_21[0], 1)])
    result = run(rig, RunOptions(handling=Handling(regulated=True)))
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, 20)
    assert "contact while opening" in str(result.reason)
    assert [force for position, _, force in jaw_moves(rig) if position > 0] == [0]


def test_tips_that_draw_back_are_not_followed_below_the_squeeze_height():
    """Taught at 80 mm, the tips stand 2 mm higher where the jaws open to 85."""
    rig = meeting(AT_21[0])
    assert run(rig, RunOptions(handling=Handling(arc=TipArc(taught_mm=80.0)))).leaf == 0
    assert min(call.arguments[2] for call in rig.log.named("move_linear")) == 10.0
