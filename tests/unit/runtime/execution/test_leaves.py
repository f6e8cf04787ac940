"""What the executor does at a leaf: it asks the auditor, takes the part and puts it down."""

from dataclasses import replace
from math import degrees, inf, radians

import pytest
from fake_cell import Deaf, FakeCell, fake_cell
from sample_tables import changed, small_table, with_job
from squeezes import ARRIVED, AT_21, AT_36, EMPTY, arm_moves, jaw_moves, run

from runtime.execution.delivery import Delivery, from_text
from runtime.execution.executor import Executor, RunOptions
from runtime.table import Area, Pose2, Table
from runtime.traversal.results import Outcome, PartResult

# -- audit ----------------------------------------------------------------------------------------


class Judge:
    def __init__(self, word: str) -> None:
        self.word, self.asked = word, []

    def judge(self, part: int, pose: Pose2, name: str | None = None) -> dict[str, object]:
        self.asked.append((part, *pose))
        return {"verdict": self.word, "residual_x_mm": 0.25, "part": 99}


@pytest.mark.parametrize("verdict", ["pass", "fail", "unknown"])
def test_executor_audit_verdict_is_recorded_and_keeps_leaf(verdict):
    judge, rig = Judge(verdict), fake_cell([AT_21])
    cell = replace(rig.cell, auditor=judge)
    result = Executor(small_table(), cell, Deaf()).run_part(7)
    assert (result.outcome, result.audit) == (Outcome.LEAF, verdict)
    assert judge.asked == [(7, 0.0, 0.5, 0.0)]
    assert ("audit", {"part": 7, "verdict": verdict, "residual_x_mm": 0.25}) in rig.journal.kept


# -- delivery -------------------------------------------------------------------------------------

DELIVERY = from_text("40,-20,90")


def test_executor_delivery_grips_part_at_leaf_and_puts_it_down():
    rig = fake_cell([AT_21, AT_21])
    result = run(rig, RunOptions(delivery=DELIVERY))
    assert (result.outcome, result.delivery, result.exit_code) == (Outcome.LEAF, "done", 0)
    heights = [target[2] for target in arm_moves(rig)]
    places = [target[:2] for target in arm_moves(rig)]
    assert heights[-6:] == [60.0, 10.0, 60.0, 60.0, 10.0, 60.0]
    assert places[-6:] == [(0.0, 0.5)] * 3 + [(40.0, -20.0)] * 3
    assert jaw_moves(rig)[-1][0] == 0
    assert rig.journal.kinds()[-3:] == ["delivery", "delivery", "outcome"]
    # The turning radius is larger for a hand that may hold a part than for an empty one.
    assert rig.arm.radii_mm[-6:] == [80.0, 80.0, 160.0, 160.0, 160.0, 80.0]


@pytest.mark.parametrize(("verdict", "delivery"), [("fail", "missed"), ("unknown", "done")])
def test_executor_delivery_of_part_that_the_audit_refutes_moves_nothing(verdict, delivery):
    rig = fake_cell([AT_21, AT_21])
    cell = replace(rig.cell, auditor=Judge(verdict))
    result = Executor(small_table(), cell, Deaf(), RunOptions(delivery=DELIVERY)).run_part(7)
    assert (result.outcome, result.audit, result.delivery) == (Outcome.LEAF, verdict, delivery)
    assert result.exit_code == (10 if verdict == "fail" else 0)
    placed = (40.0, -20.0) in [target[:2] for target in arm_moves(rig)]
    assert placed == (verdict != "fail")


def test_executor_seconds_of_part_include_its_delivery():
    rig = fake_cell([AT_21, AT_21])
    move = rig.arm.move_linear

    def move_in_a_second(*way):
        move(*way)
        rig.cell.clock.sleep(1.0)

    rig.arm.move_linear = move_in_a_second
    result = run(rig, RunOptions(delivery=DELIVERY))
    assert result.seconds == pytest.approx(len(arm_moves(rig)), abs=0.5)


def test_executor_delivery_with_grasp_arrives_at_drop_pose():
    delivery = Delivery(drop=(40.0, -20.0, 1.570796), grasp=(3.0, 1.0, 0.25))
    rig = fake_cell([AT_21, AT_21])
    assert run(rig, RunOptions(delivery=delivery)).delivery == "done"
    places = [target[:4] for target in arm_moves(rig)]
    assert places[-6] == pytest.approx((3.0, 1.5, 60.0, 0.25))
    assert places[-1] == pytest.approx((39.0, -17.0, 60.0, 1.820796), abs=1e-4)


MISSED = (Outcome.LEAF, 0, "missed", 10)


def ends(result: PartResult) -> tuple[object, ...]:
    return result.outcome, result.leaf, result.delivery, result.exit_code


@pytest.mark.parametrize("reading", [EMPTY, AT_36])
def test_executor_delivery_of_missing_part_is_reported(reading):
    rig = fake_cell([AT_21, reading])
    result = run(rig, RunOptions(delivery=replace(DELIVERY, width_mm=(20.0, 22.0))))
    assert ends(result) == MISSED
    assert "expected was 20..22 mm" in str(result.reason)
    assert rig.arm.at[:3] == (0.0, 0.5, 60.0)


@pytest.mark.parametrize("change", [{"object_flag": ARRIVED}, {"position_counts": 180}])
def test_executor_delivery_of_slipping_part_is_fault(change):
    rig = fake_cell([AT_21, AT_21])
    lift = rig.arm.move_linear

    def slip(target, *pace):
        if target[2] == 60.0 and rig.gripper.gripping:
            rig.gripper.now = rig.gripper.now._replace(**change)
        lift(target, *pace)

    rig.arm.move_linear = slip
    result = run(rig, RunOptions(delivery=DELIVERY))
    assert (result.outcome, result.exit_code, result.leaf) == (Outcome.FAULT, 20, 0)
    assert "slipped out" in str(result.reason)
    begun = next(fields for kind, fields in rig.journal.kept if kind == "delivery")
    assert begun == {"part": 1, "begun": True, "leaf": 0, "x_um": 0, "y_um": 500, "theta_urad": 0}


FAR = from_text("100,0,0")


def beyond_40(start, target) -> str:
    return "out of reach" if target[:2] == (40.0, -20.0) else ""


@pytest.mark.parametrize(
    ("delivery", "limits", "said"),
    [
        (FAR, {}, "outside the work area"),
        (DELIVERY, {"turns": (radians(-10), radians(10))}, "wrist"),
        (DELIVERY, {"obstacles": beyond_40}, "carrying it away: the way is out of reach"),
    ],
    ids=["area", "wrist", "reach"],
)
def test_executor_delivery_beyond_arm_is_refused_before_gripping(delivery, limits, said):
    rig = fake_cell([AT_21, AT_21])
    for name, limit in limits.items():
        setattr(rig.arm, name, limit)
    result = run(rig, RunOptions(delivery=delivery), table_of(1, 0.5))
    assert ends(result) == MISSED
    assert said in str(result.reason)
    assert not rig.gripper.gripping


def test_executor_delivery_uses_its_work_area():
    delivery = replace(FAR, area_um=Area(-60_000, -60_000, 120_000, 60_000))
    assert run(fake_cell([AT_21, AT_21]), RunOptions(delivery=delivery)).delivery == "done"


def taken_and_put(rig: FakeCell, text: str, table: Table) -> tuple[float, float]:
    """The hand's angles [deg] where it takes a part and where it puts the part down."""
    assert run(rig, RunOptions(delivery=from_text(text)), table).delivery == "done"
    angles = [round(degrees(target[3]), 3) for target in arm_moves(rig)]
    return angles[-5], angles[-1]


def table_of(symmetry: int, share: float | None) -> Table:
    job = "{}" if share is None else f'{{"gripper": {{"upper_finger_share": {share}}}}}'
    return changed(with_job(small_table(), job), {"goal.symmetry": symmetry})


@pytest.mark.parametrize(
    ("symmetry", "share", "angles"),
    [
        (1, None, (0, 170)),
        (2, None, (0, -10)),
        (4, None, (0, -10)),
        (1, 0.5, (0, 170)),  # a half-turned grip would not shorten the turn
        (1, 0.4, (0, 170)),
    ],
)
def test_executor_delivery_turns_to_nearest_symmetric_drop_off(symmetry, share, angles):
    rig = fake_cell([AT_21, AT_21])
    assert taken_and_put(rig, "40,-20,170", table_of(symmetry, share)) == angles


def test_executor_delivery_grips_half_turned_only_with_even_fingers():
    rig = fake_cell([AT_21, AT_21])
    rig.arm.turns = (radians(-185), radians(100))
    assert taken_and_put(rig, "40,-20,170", table_of(1, 0.5)) == (-180, -10)
    rig = fake_cell([AT_21, AT_21])
    rig.arm.turns = (radians(-185), radians(100))
    missed = run(rig, RunOptions(delivery=from_text("40,-20,170")), table_of(1, 0.3))
    assert missed.delivery == "missed"


# The way back is split into motions so small that no controller takes the short way.
@pytest.mark.parametrize(("most", "angles"), [(inf, [344, 360]), (6.2, [344, 229, 115, 0])])
def test_executor_squeeze_turns_nearest_way_within_range(most, angles):
    rig = fake_cell([AT_21])
    rig.arm.at, rig.arm.turns = (5.0, 5.0, 30.0, 6.0), (-inf, most)
    run(rig, RunOptions())
    turned = [round(degrees(target[3])) for target in arm_moves(rig)]
    assert turned[: len(angles)] == angles
    assert turned[-1] == angles[-1]
