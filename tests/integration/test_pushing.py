"""Parts that may lie outside the open jaws are pushed first, then squeezed and located."""

from dataclasses import replace
from pathlib import Path

import pytest
from programs import JOB, VIRTUAL, called
from written_journals import assert_sound

from drivers.sim.physics import scene
from planner.cli import export, report
from planner.compile import compile_job
from planner.errors import NoPlanError
from planner.evaluation.disturbance import NONE
from planner.evaluation.evaluate import evaluate
from planner.evaluation.ppm import Study, copies_of
from planner.evaluation.trials import Program
from planner.job import model as job_file
from planner.world import ContactWorlds
from runtime import cli
from runtime.journal.chain import records
from runtime.shell.errors import UsageError
from runtime.table import Schedule, Squeezed, Table, dump, job_of

CHANGES = {
    "gripper": {"opening_mm": 50.0},
    "uncertainty": {"radius_mm": 12.0, "orientation_halfwidth_deg": 20.0},
    "doubt": {"chance": 0.0},
    "friction": {"doubt": 0.0},
    "actions": {"proposals": "belief", "pushes": "belief"},
    "search": {"particles": 600, "max_depth": 2},
}


@pytest.fixture(scope="module")
def job() -> job_file.Job:
    return job_file.load(JOB, CHANGES)


@pytest.fixture(scope="module")
def table(job: job_file.Job) -> Table:
    return compile_job(job, workers=2, trials=300).table


@pytest.fixture(scope="module")
def path(table: Table, tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = tmp_path_factory.mktemp("pushing") / "plate.msgpack"
    dump(table, result)
    return result


class Still:
    """A world that cannot push."""

    def squeeze(self, pose_hand: object) -> tuple[object, float, str]:
        return pose_hand, 20.0, "grasped"


def test_compile_job_wide_part_without_pushes_raises_no_plan(job: job_file.Job) -> None:
    with pytest.raises(NoPlanError, match="no first squeeze is free of collision"):
        compile_job(job.replaced(actions={"pushes": "none"}), trials=100)


def test_pushing_table_locates_parts_in_trials_and_in_cell(job, table, path, tmp_path):
    result = evaluate(table, job, ContactWorlds.of_job(job, 77), 500, 77)
    assert table.nodes[0].pushes
    assert result.success.mean() >= 0.97
    assert result.crashes <= 5
    still = evaluate(without_pushes(table), job, ContactWorlds.of_job(job, 77), 300, 77)
    assert still.success.mean() < 0.5  # the pushes are needed
    journal = tmp_path / "run.jsonl"
    words = ("--tree", path, *VIRTUAL, "--count", "3", "--journal", journal)
    code, out, _ = called(cli.main, *words)
    assert code == 0
    assert "3 LEAF, 3 within 3 mm, 0 crashes" in out
    assert "pushing" in {record["kind"] for record in records(journal)}
    assert_sound(journal)


def test_evaluate_and_scene_world_without_push_is_refused(job, table, path):
    with pytest.raises(UsageError, match=r"pushes parts, and the world Still has no push\(\)"):
        evaluate(table, job, Still(), 10, 1)
    setting = scene.load(path, None, "planner.world:make")
    assert setting.pushing
    still = setting._replace(factory=lambda job, seed: Still())
    with pytest.raises(UsageError, match=r"has no push\(\) and the table pushes"):
        still.make_worlds(1)


def without_pushes(table: Table) -> Table:
    return replace(table, nodes=tuple(node._replace(pushes=()) for node in table.nodes))


def test_schedule_pushes_take_time_of_their_paths(job: job_file.Job, table: Table) -> None:
    squeeze, pushes = table.nodes[0].squeeze, table.nodes[0].pushes
    ways = sum(push.length_um / push.speed_um_s for push in pushes)
    lifts = 2 * len(pushes) * (table.limits.retreat_height_um - table.limits.squeeze_height_um)
    schedule = Schedule.of(table, job_of(table))
    phases, *_ = schedule.squeeze(Squeezed(0, 10.0, 0), None, None, first=True)
    taken = phases.push_s
    # Without the jaws and the ways between the pushes.
    least = ways + lifts / table.limits.arm_speed_um_s
    assert least < taken < 2.0 * least + len(pushes) * 4 * squeeze.opening_um / squeeze.speed_um_s
    result = evaluate(table, job, ContactWorlds.of_job(job, 5), 200, 5)
    assert result.seconds[result.squeezes > 0].min() > taken


def test_ppm_study_of_pushing_table_has_few_wrong_answers_and_crashes(
    job: job_file.Job, table: Table
) -> None:
    study = Study(Program.of(table), job, ContactWorlds.of_job(job, 3), 3, copies_of(table), NONE)
    sums = study(0)
    assert sums.wrong.sum() / sums.parts < 0.01
    assert sums.crashed / sums.parts < 0.005


@pytest.mark.parametrize(
    ("command", "words", "code", "message"),
    [
        (export, "TABLE --to c99 -o OUT", 2, "an export is for squeezes alone"),
        (report, "TABLE -o OUT.html --bound", 2, "--bound is for squeezes alone"),
        (cli, "--tree TABLE --serve tcp://127.0.0.1:0", 3, "a robot that asks does not"),
    ],
)
def test_command_without_pushes_refuses_pushing_table(
    command, words, code, message, path, tmp_path
):
    at = {"TABLE": path, "OUT": tmp_path / "out", "OUT.html": tmp_path / "out.html"}
    refused = called(command.main, *(at.get(word, word) for word in words.split()))
    assert refused.code == code
    assert message in refused.err
    assert 'plan with actions.pushes = "none"' in refused.err
    assert not list(tmp_path.iterdir())


def test_dry_run_and_plan_report_list_pushes(path: Path, table: Table, tmp_path: Path) -> None:
    dry = called(cli.main, "--tree", path, "--port", "sim", "--dry-run")
    assert dry.code == 0
    push = table.nodes[0].pushes[0]
    assert f"push from ({push.x_um / 1000:.2f}, {push.y_um / 1000:.2f}) mm" in dry.out
    page = tmp_path / "report.html"
    assert report.main([str(path), "-o", str(page), "--trials", "100"]) == 0
    assert f"{len(table.nodes[0].pushes)} pushes, " in page.read_text(encoding="utf-8")
