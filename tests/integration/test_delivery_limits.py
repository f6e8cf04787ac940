"""Limits of deliveries: the turns of the wrist, the arm's reach, the force of the grip, a part that slips.

The wrist is that of the simulated arm, which adds up its turns and halts without a message where an axis
leaves its range, as a real controller does.
"""

import json
from dataclasses import replace
from math import radians
from pathlib import Path

import pytest
from counting import SETTINGS
from fake_cell import fake_cell
from programs import REHEARSAL, VIRTUAL, Ended, called
from sample_tables import small_table, with_job
from soaking import small_setting, soak_run
from squeezes import AT_21, jaw_moves, run
from tapped_devices import TappedArm, TappedGripper

from drivers.abb.kinematics import LAST_AXIS_DEG
from drivers.sim.faults import Fault, Listed
from drivers.sim.virtual.cell import VirtualCell
from runtime.cli import main
from runtime.execution.delivery import Delivery, from_text
from runtime.execution.executor import RunOptions
from runtime.execution.handling import Handling
from runtime.journal.chain import records
from runtime.table import Table, Tolerance, dump
from runtime.traversal.results import Outcome

# With this drop-off each part that takes both squeezes turns the hand once round in the same direction.
WINDING = RunOptions(handling=Handling(regulated=True), delivery=from_text("50,0,210"))
WIDE = """
drop = [{x}, 0.0, 0.0]
area_mm = [-1000, -1000, 1000, 1000]
"""


def marked_table() -> Table:
    """The small table of a part without symmetry."""
    table = small_table()
    return replace(table, goal=replace(table.goal, symmetry=1))


def soaked(parts: int, faults: Listed | None = None) -> object:
    soak = soak_run.Soak(small_setting(), marked_table(), faults is not None, parts, (WINDING,))
    return soak_run.run(soak, 5, faults)


def simulated(tree: Path, *words: str) -> Ended:
    """Runs grasp-runtime on a table, with a simulated cell in virtual time."""
    given = (*VIRTUAL, *REHEARSAL, "--tree", tree, "--journal", tree.with_name("j"))
    return called(main, *given, *words)


@pytest.fixture
def tree(tree: Path) -> Path:
    """The file of the marked table."""
    dump(marked_table(), tree)
    return tree


def test_delivery_repeated_turns_keep_wrist_within_its_range() -> None:
    counts = soaked(80)
    assert (counts.findings, counts.sums["halts"]) == ([], 0)
    assert counts.sums["delivered"] == counts.outcomes["leaf"] > 60
    low, high = counts.wrist_deg
    assert LAST_AXIS_DEG[0] < low < high < LAST_AXIS_DEG[1]


def test_delivery_without_limit_of_turns_halts_arm_with_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("drivers.abb.arm.Arm._overturn", lambda *_: "")
    monkeypatch.setattr(
        "drivers.abb.arm.Arm.turn_range", lambda *_: (radians(-2000), radians(2000))
    )
    monkeypatch.setattr("runtime.table.geometry.MOST_TURNS", 9)
    monkeypatch.setattr("runtime.execution.safety.MOST_TURNS", 9)
    counts = soaked(60)
    assert counts.sums["halts"] == 1
    assert (counts.last.outcome, counts.last.exit_code) == (Outcome.FAULT, 20)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("100,0,0",), "delivery from leaf 0: putting it down: (100.00, 0.00) mm is outside"),
        (("100,0,0", "--json"), "(100.00, 0.00) mm is outside"),
        (("far.toml",), "out of the arm's reach"),
    ],
)
def test_grasp_runtime_unreachable_drop_off_is_refused_before_motion(
    tree: Path, more: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tree.parent)
    Path("far.toml").write_text(WIDE.format(x=700))
    code, _, err = simulated(tree, "--deliver", *more)
    assert (code, err.count("\n")) == (20, 1 + ("--json" in more))
    assert message in err
    assert not Path("j").exists()


def test_check_and_dry_run_unreachable_drop_off_is_refused(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tree.parent))
    far = tree.with_name("far.toml")
    far.write_text(WIDE.format(x=700))

    def output(*words: str) -> tuple[int, str]:
        code, out, err = called(main, "--tree", tree, *words)
        return code, err if code else out

    assert output("--check", "--deliver", "100,0,0")[0] == 20
    code, words = output("--check", "--deliver", "50,0,180")
    assert (code, "can be delivered" in words) == (0, True)
    with TappedGripper() as gripper, TappedArm() as arm:
        dry = ("--dry-run", "--port", gripper.path, "--arm", f"{arm.url}?base=-300,0,0")
        code, words = output(*dry, "--deliver", str(far))
        assert (code, words.count("\n"), "out of the arm's reach" in words) == (20, 1, True)
        code, words = output(*dry, "--deliver", "50,0,180")
        assert (code, "delivery: the part from every leaf" in words) == (0, True)
        code, words = output(*dry[:-1], f"{dry[-1]}&wrist=170,190", "--deliver", "50,0,180")
        assert (code, words.count("\n"), "wrist" in words) == (20, 1, True)
        assert set(arm.codes) <= {0, 3, 4, 99}


@pytest.mark.parametrize(
    ("goal", "named"),
    [({"kind": "orientation"}, "orientation"), ({"kind": "modes", "modes": 2}, "modes (2 poses)")],
)
def test_delivery_under_a_goal_that_leaves_the_pose_open_is_refused(
    tmp_path: Path, goal: dict[str, object], named: str
) -> None:
    tree = tmp_path / "t.msgpack"
    table = small_table()
    tolerance = Tolerance(0, 0, 87_266 if goal["kind"] == "orientation" else 0)
    dump(replace(table, goal=replace(table.goal, **goal, tolerance=tolerance)), tree)
    code, _, err = called(main, "--tree", tree, "--check", "--deliver", "50,0,180")
    assert (code, err.count("\n")) == (2, 1)
    assert f"the table's goal, {named}, leaves open where a part lies" in err
    assert called(main, "--tree", tree, "--check", "--deliver", "no")[0] == 0


def test_delivery_of_slipping_part_is_fault_and_keeps_leaf() -> None:
    counts = soaked(9, Listed([Fault("part_slips", at=0, length=9)]))
    assert (counts.findings, counts.last.outcome, counts.last.exit_code) == ([], Outcome.FAULT, 20)
    assert counts.last.leaf == ~counts.last.steps[-1].target


@pytest.mark.parametrize(("delivery", "forces_n"), [(None, [20]), (WINDING.delivery, [20, 20, 40])])
def test_executor_only_carried_part_is_gripped_with_force_of_table(
    delivery: Delivery | None, forces_n: list[float]
) -> None:
    rig = fake_cell([AT_21, AT_21])
    options = RunOptions(handling=Handling(regulated=True), delivery=delivery)
    assert run(rig, options).outcome is Outcome.LEAF
    closings = [force for position, _, force in jaw_moves(rig) if position == 255]
    assert closings == [SETTINGS.force(force) for force in forces_n]


def test_grasp_runtime_job_with_delivery_journals_pose_before_outcome(tree: Path) -> None:
    job = {"delivery": {"drop": [40.0, -20.0, 90.0]}}
    dump(with_job(small_table(), json.dumps(job)), tree)
    code, out, err = simulated(tree, "--seed", "1")
    assert (code, err) == (0, "")
    assert "delivery: done" in out
    kinds = [entry["kind"] for entry in records(tree.with_name("j"))]
    begun = next(entry for entry in records(tree.with_name("j")) if entry["kind"] == "delivery")
    assert kinds.index("delivery") < kinds.index("outcome")
    assert {"leaf", "x_um", "y_um", "theta_urad"} <= begun.keys()


def test_move_linear_turn_keeps_speed_160_mm_from_axis() -> None:
    """No point within 160 mm of the hand's axis may move faster than the requested speed."""
    cell = VirtualCell(small_setting(), 1)
    arm = cell.arm()
    arm.move_linear((0.0, 0.0, 80.0, 0.0), 20.0)
    began = cell.clock.now()
    arm.move_linear((0.0, 0.0, 80.0, radians(90.0)), 20.0)
    assert cell.clock.now() - began >= radians(90.0) * 160.0 / 20.0
