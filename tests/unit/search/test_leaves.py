"""What the executor does at a leaf: it asks the auditor, takes the part and puts it down."""

from dataclasses import replace

import pytest
from fake_cell import fake_cell
from sample_tables import small_table
from squeezes import ARRIVED, AT_21, AT_36, EMPTY, jaw_moves, run

from runtime.delivery import Delivery, from_text
from runtime.executor import Executor, Plan
from runtime.results import Outcome

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
