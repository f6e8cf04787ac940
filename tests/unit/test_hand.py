"""What the executor does beyond the plain loop: gentle force, level tips, drags, audit, delivery."""

import math
from dataclasses import FrozenInstanceError, replace
from itertools import pairwise

import pytest
from fake_cell import FakeCell, Log, State, fake_cell
from sample_tables import GRIPPER, LIMITS, small_table, with_node

from runtime.decision import Policy
from runtime.delivery import Delivery, from_text
from runtime.errors import GripperStateError, TableError
from runtime.executor import Executor, Plan
from runtime.hand import Hand, Handling
from runtime.phases import Phase
from runtime.results import Outcome, PartResult
from runtime.strokes import GENTLE_FORCE, GENTLE_SPEED, force_counts, opening_counts
from runtime.table import Calibration, Table
from runtime.tips import TipArc

CALIBRATION = Calibration.linear(GRIPPER)
CONTACT, ARRIVED = 2, 3
AT_21, AT_30, AT_36, AT_60 = (
    (CALIBRATION.count(width), CONTACT) for width in (21_000, 30_000, 36_000, 60_000)
)
EMPTY = (229, ARRIVED)
CLOSED = (229, CONTACT)  # on something thinner than a count
ARC = TipArc()


def run(made: FakeCell, plan: Plan, table: Table | None = None, phases: list | None = None) -> PartResult:
    seen = [] if phases is None else phases
    executor = Executor(
        table or small_table(),
        made.cell,
        lambda part, step: None,
        plan,
        lambda part, phase, node: seen.append((phase, node)),
    )
    return executor.run_part(1)


def meeting(stop: int) -> FakeCell:
    """A cell whose jaws meet the part at a count, whatever they are asked to close to."""
    made = fake_cell([])

    def meet(position_counts: int, speed_counts: int, force_counts: int) -> None:
        made.log.call("gripper", "move", position_counts, speed_counts, force_counts)
        count, flag = (stop, CONTACT) if position_counts > stop else (max(position_counts, 3), ARRIVED)
        made.gripper.now = State(object_flag=flag, echo_counts=position_counts, position_counts=count)

    made.gripper.move = meet
    return made


def jaw_moves(made: FakeCell) -> list[tuple]:
    return [call.arguments for call in made.log.named("move")]


# -- force ----------------------------------------------------------------------------------------


def test_a_regulated_squeeze_meets_the_part_gently_and_only_then_raises_the_force() -> None:
    made = fake_cell([AT_21])
    assert run(made, Plan(handling=Handling(regulated=True))).leaf == 0
    near, touch, hold = jaw_moves(made)[1:4]
    node_force = force_counts(40_000)
    assert near[0] < AT_30[0]  # wider than any outcome
    assert near[2] == GENTLE_FORCE
    assert touch == (255, GENTLE_SPEED, GENTLE_FORCE)
    assert hold == (255, GENTLE_SPEED, node_force)


def test_a_part_met_early_is_still_only_touched_first() -> None:
    made = meeting(AT_60[0])
    result = run(made, Plan(handling=Handling(regulated=True)))
    assert result.outcome is Outcome.REJECT  # nobody planned for 60 mm
    forces = [force for position, _, force in jaw_moves(made) if position > 0]
    assert forces == [GENTLE_FORCE, GENTLE_FORCE, force_counts(40_000)]


def test_the_motor_current_ends_the_raising() -> None:
    table = small_table()
    squeeze = table.nodes[0].squeeze._replace(force_mn=200_000)
    table = with_node(table, 0, table.nodes[0]._replace(squeeze=squeeze))
    table = replace(table, limits=replace(table.limits, max_force_mn=235_000))
    for grip_current_ma, raises in [(None, 4), (299, 0), (300, 0), (301, 4)]:
        made = fake_cell([AT_21])
        handling = Handling(regulated=True, grip_current_ma=grip_current_ma)
        assert run(made, Plan(handling=handling), table).leaf == 0
        closings = [force for position, _, force in jaw_moves(made) if position == 255]
        assert len(closings) == 1 + raises


def test_a_part_that_slips_out_while_the_force_rises_is_told_by_its_width() -> None:
    made = fake_cell([AT_21])
    move = made.gripper.move

    def slip(position_counts: int, speed_counts: int, force_counts: int) -> None:
        move(position_counts, speed_counts, force_counts)
        if position_counts == 255 and force_counts > GENTLE_FORCE:
            made.gripper.now = made.gripper.now._replace(position_counts=229, object_flag=ARRIVED)

    made.gripper.move = slip
    table = small_table()
    squeeze = table.nodes[0].squeeze._replace(force_mn=200_000)  # four raises, of which the first loses it
    table = with_node(table, 0, table.nodes[0]._replace(squeeze=squeeze))
    table = replace(table, limits=replace(table.limits, max_force_mn=235_000))
    result = run(made, Plan(handling=Handling(regulated=True)), table)
    assert (result.outcome, result.reason) == (Outcome.REJECT, "the fingers closed on nothing")
    assert [force for position, _, force in jaw_moves(made) if position == 255] == [GENTLE_FORCE, 64]


def test_nothing_between_the_fingers_is_not_squeezed_harder() -> None:
    made = fake_cell([EMPTY])
    assert run(made, Plan(handling=Handling(regulated=True))).outcome is Outcome.REJECT
    assert [force for position, _, force in jaw_moves(made) if position > 0] == [GENTLE_FORCE, GENTLE_FORCE]


def test_a_current_that_cannot_be_is_a_fault_and_no_child() -> None:
    made = fake_cell([AT_21])
    made.gripper.current_ma = 1500
    result = run(made, Plan())
    assert (result.outcome, result.exit_code, result.steps) == (Outcome.FAULT, 21, ())


# -- tips -----------------------------------------------------------------------------------------


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
def test_level_tips_stay_at_their_height_while_the_jaws_move(regulated: bool, arc: TipArc, stop) -> None:
    made = meeting(stop[0])
    result = run(made, Plan(handling=Handling(regulated=regulated, arc=arc)))
    assert result.outcome is (Outcome.LEAF if stop == AT_21 else Outcome.REJECT)
    low_mm, width_mm, tips = 10.0, 0.0, []
    z_mm, down = 30.0, False
    for call in made.log.calls:
        if call.name == "move_linear":
            z_mm = call.arguments[2]
            down = down or (z_mm < 30.0)
        elif call.name == "move" and down and z_mm < 30.0:
            start_mm, count = width_mm, call.arguments[0]
            width_mm = CALIBRATION.width_um(min(count, stop[0])) / 1000
            tips += [
                z_mm - arc.advance_mm(start_mm + (width_mm - start_mm) * k / 20)
                for k in range(21)
                if abs(width_mm - 85.0) > 1.0  # the last opening is not followed: the tips draw back
            ]
        elif call.name == "move":
            width_mm = CALIBRATION.width_um(max(call.arguments[0], 3)) / 1000
    targets = [call.arguments[:4] for call in made.log.named("move_linear")]
    assert all(math.dist(before[:3], after[:3]) > 0.05 for before, after in pairwise(targets))
    assert tips
    assert low_mm - 0.1 <= min(tips) <= max(tips) <= low_mm + arc.level_mm + 0.15


def test_tips_stay_level_until_the_jaws_are_five_millimetres_clear_of_the_part() -> None:
    made = meeting(AT_21[0])
    assert run(made, Plan(handling=Handling(arc=ARC))).leaf == 0
    calls = [call for call in made.log.calls if call.name in ("move", "move_linear")]
    closed = max(k for k, call in enumerate(calls) if call.name == "move" and call.arguments[0] == 255)
    clear, level, wide = calls[closed + 1 : closed + 4]
    assert clear.arguments[0] == opening_counts(26_000, CALIBRATION)
    assert level.arguments[2] == pytest.approx(10.0 + ARC.advance_mm(26.0), abs=0.05)
    assert wide.arguments[0] == 0


def test_tips_are_not_followed_beyond_the_squeeze_opening() -> None:
    table = small_table()
    squeeze = table.nodes[0].squeeze._replace(opening_um=60_000)
    made = meeting(CALIBRATION.count(58_000))
    run(made, Plan(handling=Handling(arc=ARC)), with_node(table, 0, table.nodes[0]._replace(squeeze=squeeze)))
    opened = {position for position, _, _ in jaw_moves(made)} - {255}
    assert min(opened) == opening_counts(60_000, CALIBRATION)


def test_a_cell_without_room_for_the_arc_is_refused() -> None:
    made = fake_cell([])
    low = replace(LIMITS, retreat_height_um=23_000)
    with pytest.raises(TableError, match=r"takes the arm up to 24.0 mm, the retreat height is 23 mm"):
        Hand(made.gripper, made.arm, made.cell.clock, low, CALIBRATION, Handling(arc=ARC))
    with pytest.raises(TableError, match="teach the tool frame with the jaws fully open"):
        Hand(
            made.gripper, made.arm, made.cell.clock, LIMITS, CALIBRATION, Handling(arc=TipArc(taught_mm=40.0))
        )


def test_an_arc_whose_links_would_lie_flat_is_refused() -> None:
    """Half of 85 mm less the offset is as long as the link: the arc has no height left there."""
    made = fake_cell([])
    room = replace(LIMITS, retreat_height_um=200_000)
    for link_mm, refused in ((30.0, True), (40.0, True), (40.01, False)):
        flat = Handling(arc=TipArc(link_mm=link_mm, offset_mm=2.5))
        if not refused:
            Hand(made.gripper, made.arm, made.cell.clock, room, CALIBRATION, flat)
            continue
        with pytest.raises(TableError, match="check link and offset"):
            Hand(made.gripper, made.arm, made.cell.clock, room, CALIBRATION, flat)


@pytest.mark.parametrize(("taught_mm", "refused"), [(79.99, True), (80.0, False), (85.0, False)])
def test_the_tool_frame_is_taught_with_the_jaws_open_or_nearly_so(taught_mm: float, refused: bool) -> None:
    made, taught = fake_cell([]), Handling(arc=TipArc(taught_mm=taught_mm))
    if not refused:
        Hand(made.gripper, made.arm, made.cell.clock, LIMITS, CALIBRATION, taught)
        return
    with pytest.raises(TableError, match=f"was taught at {taught_mm:g} mm and the jaws open to 85 mm"):
        Hand(made.gripper, made.arm, made.cell.clock, LIMITS, CALIBRATION, taught)


def test_the_arc_s_top_lies_below_the_retreat_height() -> None:
    """Link 50, offset 2.5: the tips advance by 30 mm at 85 mm of width and by 50 at 5, the arc's top."""
    made, arc = fake_cell([]), Handling(arc=TipArc(link_mm=50.0, offset_mm=2.5))
    for retreat_um, refused in ((30_000, True), (30_001, False)):
        limits = replace(LIMITS, squeeze_height_um=10_000, retreat_height_um=retreat_um)
        if not refused:
            Hand(made.gripper, made.arm, made.cell.clock, limits, CALIBRATION, arc)
            continue
        with pytest.raises(TableError, match=r"takes the arm up to 30.0 mm, the retreat height is 30 mm"):
            Hand(made.gripper, made.arm, made.cell.clock, limits, CALIBRATION, arc)


@pytest.mark.parametrize(("z_mm", "moves"), [(59.94, 1), (59.95, 0), (60.0, 0), (75.0, 0)])
def test_an_arm_that_is_up_is_not_sent_there_again(z_mm: float, moves: int) -> None:
    made = fake_cell([])
    made.arm.at = (1.0, 2.0, z_mm, 0.5)
    Hand(made.gripper, made.arm, made.cell.clock, LIMITS, CALIBRATION, Handling()).retreat()
    targets = [call.arguments[:4] for call in made.log.named("move_linear")]
    assert targets == [(1.0, 2.0, 60.0, 0.5)] * moves


def test_contact_while_opening_is_no_contact_to_squeeze_harder_on() -> None:
    made = fake_cell([(AT_21[0], 1)])
    result = run(made, Plan(handling=Handling(regulated=True)))
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, 21)
    assert "contact while opening" in str(result.reason)
    assert [force for position, _, force in jaw_moves(made) if position > 0] == [GENTLE_FORCE, GENTLE_FORCE]


def test_tips_that_draw_back_are_not_followed_below_the_squeeze_height() -> None:
    """Taught at 80 mm, the tips stand 2 mm higher where the jaws open to 85."""
    made = meeting(AT_21[0])
    assert run(made, Plan(handling=Handling(arc=TipArc(taught_mm=80.0)))).leaf == 0
    assert min(call.arguments[2] for call in made.log.named("move_linear")) == 10.0


def test_how_far_the_jaws_open_is_what_the_calibration_says() -> None:
    wide = Calibration((91_000, *CALIBRATION.widths_um[1:]))
    made = fake_cell([])
    with pytest.raises(TableError, match="was taught at 85 mm and the jaws open to 91 mm"):
        Hand(made.gripper, made.arm, made.cell.clock, LIMITS, wide, Handling(arc=ARC))
    hand = Hand(made.gripper, made.arm, made.cell.clock, LIMITS, CALIBRATION, Handling())
    assert hand.width_mm(AT_21[0]) == CALIBRATION.width_um(AT_21[0]) / 1000


def test_where_the_arm_stands_is_known_once_it_has_answered() -> None:
    made = fake_cell([])
    hand = Hand(made.gripper, made.arm, made.cell.clock, LIMITS, CALIBRATION, Handling())
    assert not hasattr(Handling(), "__dict__")
    with pytest.raises(FrozenInstanceError):
        Handling().regulated = True
    assert hand.where() == (5.0, 5.0, 30.0, 0.1)
    assert hand.arm_known

    def silent() -> tuple[float, float, float, float]:
        raise ConnectionError("2.0 s of silence")

    made.arm.pose = silent
    with pytest.raises(ConnectionError):
        hand.where()
    assert not hand.arm_known


# -- drags ----------------------------------------------------------------------------------------


def test_what_is_held_is_dragged_to_the_release_point_and_let_go_there() -> None:
    table = small_table()
    table = with_node(table, 0, table.nodes[0]._replace(release=(12_000, -7_000)))
    made = fake_cell([AT_21])
    made.arm.at = (5.0, 5.0, 60.0, 0.1)
    assert run(made, Plan(), table).leaf == 0
    motions = [call.arguments[:4] for call in made.log.calls if call.name == "move_linear"]
    assert motions[-2:] == [(12.0, -7.0, 10.0, 0.0), (12.0, -7.0, 60.0, 0.0)]
    names = [call.name for call in made.log.calls if call.name in ("move", "move_linear")]
    assert names[-3:] == ["move_linear", "move", "move_linear"]
    rejected = fake_cell([AT_36])
    run(rejected, Plan(), table)
    assert (12.0, -7.0) not in {call.arguments[:2] for call in rejected.log.named("move_linear")}


def test_a_drag_never_sends_the_tips_below_the_squeeze_height() -> None:
    table = small_table()
    table = with_node(table, 0, table.nodes[0]._replace(release=(12_000, -7_000)))
    made = fake_cell([AT_21])
    pose = made.arm.pose

    def rounded() -> tuple[float, float, float, float]:
        x, y, z, angle = pose()
        return x, y, z - 0.01, angle

    made.arm.pose = rounded
    assert run(made, Plan(), table).leaf == 0


# -- policies -------------------------------------------------------------------------------------


def test_policies_squeeze_again_and_start_over() -> None:
    made = fake_cell([AT_30, AT_30, AT_30, AT_21])
    result = run(made, Plan(Policy.of("resqueeze,restart,next", "next")))
    assert (result.outcome, result.leaf) == (Outcome.LEAF, 0)
    assert [step.node for step in result.steps] == [0, 1, 1, 0]
    assert [step.number for step in result.steps] == [1, 2, 3, 4]


def test_an_unresolved_part_may_be_started_over() -> None:
    made = fake_cell([AT_30, AT_36, AT_21])
    result = run(made, Plan(Policy.of("next", "restart,stop")))
    assert (result.outcome, [step.node for step in result.steps]) == (Outcome.LEAF, [0, 1, 0])


def test_phases_go_by_in_their_order() -> None:
    phases: list = []
    run(fake_cell([AT_21]), Plan(delivery=None), phases=phases)
    assert phases == [
        (Phase.PLACE, 0),
        (Phase.SQUEEZE, 0),
        (Phase.READ, 0),
        (Phase.RELEASE, 0),
        (Phase.DONE, None),
    ]
    run(fake_cell([AT_21], Log(3, ConnectionError("cable"))), Plan(), phases=phases)
    assert phases[-1] == (Phase.SAFE, None)


# -- audit ----------------------------------------------------------------------------------------


class Judge:
    def __init__(self, word: object) -> None:
        self.word, self.asked = word, []

    def judge(self, part: int, x_mm: float, y_mm: float, theta_rad: float) -> dict[str, object]:
        self.asked.append((part, x_mm, y_mm, theta_rad))
        if isinstance(self.word, Exception):
            raise self.word
        return {"verdict": self.word, "residual_x_mm": 0.25, "part": 99, "odd": [1], "endless": float("inf")}


@pytest.mark.parametrize(
    ("word", "verdict"),
    [("pass", "pass"), ("fail", "fail"), ("unknown", "unknown"), ("maybe", "unknown"), (None, "unknown")],
)
def test_the_auditor_is_asked_at_leaves_and_never_stops_the_cell(word, verdict) -> None:
    judge, made = Judge(word), fake_cell([AT_21])
    cell = replace(made.cell, auditor=judge)
    result = Executor(small_table(), cell, lambda part, step: None).run_part(7)
    assert (result.outcome, result.audit) == (Outcome.LEAF, verdict)
    assert judge.asked == [(7, 0.0, 0.5, 0.0)]
    assert ("audit", {"part": 7, "verdict": verdict, "residual_x_mm": 0.25}) in made.journal.kept


def test_a_broken_auditor_knows_nothing_and_a_reject_is_not_audited() -> None:
    made = fake_cell([AT_21, AT_36])
    judge = Judge(ValueError("no camera"))
    executor = Executor(small_table(), replace(made.cell, auditor=judge), lambda part, step: None)
    assert executor.run_part(1).audit == "unknown"
    assert executor.run_part(2).audit is None
    assert len(judge.asked) == 1


# -- delivery -------------------------------------------------------------------------------------

DELIVERY = from_text("40,-20,90")


def test_a_localised_part_is_taken_at_its_pose_and_put_down() -> None:
    made = fake_cell([AT_21, AT_21])
    result = run(made, Plan(delivery=DELIVERY))
    assert (result.outcome, result.delivery, result.exit_code) == (Outcome.LEAF, "done", 0)
    heights = [call.arguments[2] for call in made.log.named("move_linear")]
    places = [call.arguments[:2] for call in made.log.named("move_linear")]
    assert heights[-6:] == [60.0, 10.0, 60.0, 60.0, 10.0, 60.0]
    assert places[-6:] == [(0.0, 0.5)] * 3 + [(40.0, -20.0)] * 3
    assert jaw_moves(made)[-1][0] == 0
    assert made.journal.kinds()[-3:] == ["delivery", "delivery", "outcome"]


def test_the_hand_is_placed_so_that_the_part_arrives_at_its_pose() -> None:
    delivery = Delivery(drop=(40.0, -20.0, 1.570796), grasp=(3.0, 1.0, 0.25))
    made = fake_cell([AT_21, AT_21])
    assert run(made, Plan(delivery=delivery)).delivery == "done"
    taken, put = (
        call.arguments[:4] for call in (made.log.named("move_linear")[-6], made.log.named("move_linear")[-1])
    )
    assert taken == pytest.approx((3.0, 1.5, 60.0, 0.25))
    assert put == pytest.approx((39.0, -17.0, 60.0, 1.820796), abs=1e-4)


@pytest.mark.parametrize("reading", [EMPTY, AT_36])
def test_a_part_that_is_not_there_is_left_and_told(reading) -> None:
    made = fake_cell([AT_21, reading])
    delivery = replace(DELIVERY, width_mm=(20.0, 22.0))
    result = run(made, Plan(delivery=delivery))
    assert (result.outcome, result.leaf, result.delivery, result.exit_code) == (Outcome.LEAF, 0, "missed", 12)
    assert "expected was 20..22 mm" in str(result.reason)
    assert made.arm.at[:3] == (0.0, 0.5, 60.0)


@pytest.mark.parametrize("change", [{"object_flag": ARRIVED}, {"position_counts": 180}])
def test_a_part_that_slips_while_it_is_carried_is_a_fault(change) -> None:
    made = fake_cell([AT_21, AT_21])
    lift = made.arm.move_linear

    def slip(x_mm: float, y_mm: float, z_mm: float, angle_rad: float, speed_mm_s: float) -> None:
        if z_mm == 60.0 and made.gripper.gripping:
            made.gripper.now = made.gripper.now._replace(**change)
        lift(x_mm, y_mm, z_mm, angle_rad, speed_mm_s)

    made.arm.move_linear = slip
    result = run(made, Plan(delivery=DELIVERY))
    assert (result.outcome, result.exit_code, result.leaf) == (Outcome.FAULT, 21, None)
    assert "slipped out" in str(result.reason)


def test_a_drop_off_outside_the_area_is_refused_and_one_inside_its_own_is_not() -> None:
    far = from_text("100,0,0")
    made = fake_cell([AT_21, AT_21])
    result = run(made, Plan(delivery=far))
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, 22)
    made = fake_cell([AT_21, AT_21])
    delivery = replace(far, area_um=(-60_000, -60_000, 120_000, 60_000))
    assert run(made, Plan(delivery=delivery)).delivery == "done"


def test_unready_grippers_are_not_waited_for_for_ever() -> None:
    made = fake_cell([])
    made.gripper.now = State(moving=True)
    hand = Hand(made.gripper, made.arm, made.cell.clock, LIMITS, CALIBRATION, Handling())
    with pytest.raises(GripperStateError, match="without having been asked"):
        hand.await_stillness()
    assert made.cell.clock.now() >= 8.0
