"""A job with several parts, from its plan to a run: two squares are sorted by their size."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from html_pages import Page
from programs import VIRTUAL, called

from drivers.camera.audit.subject import from_table
from drivers.camera.vision.tag_file import PartTag
from planner.cli import compile as compile_command
from planner.cli import evaluate as evaluate_command
from planner.cli import report
from planner.compile import compile_job
from planner.diagnosis.cautions import hardly_located
from planner.errors import NoPlanError
from planner.evaluation.evaluate import evaluate
from planner.evaluation.foreign import tried
from planner.evaluation.leaves import identities
from planner.evaluation.outcome import CRASHED, REJECTED, Evaluation
from planner.job import model as job_file
from planner.work.scheduler import Threads
from planner.world import ContactWorlds
from runtime import cli
from runtime.journal.export import rows
from runtime.shell.errors import InputError
from runtime.table import dump, dumps, loads

COUNT_MM = 0.38
SQUARE = """
[[hypothesis]]
name = "{name}"
share = {share}
[hypothesis.part]
outline_mm = [[0, 0], [{side}, 0], [{side}, {side}], [0, {side}]]
"""
COMMON = """
[friction]
finger_part_min = 0.4
finger_part_max = 0.6
[gripper]
finger_length_mm = 27.5
finger_width_mm = 9.5
opening_mm = 85.0
[uncertainty]
radius_mm = 4
orientation = "unknown"
[actions]
angles_deg = [0, 45, 90, 135]
centers_mm = [[0, 0]]
[goal]
kind = "identity"
distance_mm = 3.0
confidence = 0.99
[search]
particles = 400
"""


def squares(small: float, large: float) -> str:
    """The TOML of two hypotheses, squares with these sides [mm]."""
    one = SQUARE.format(name="small", share=0.3, side=small)
    return one + SQUARE.format(name="large", share=0.7, side=large)


@pytest.fixture(scope="module")
def job() -> job_file.Job:
    return job_file.parse(COMMON + squares(20, 34))


@pytest.fixture(scope="module")
def plan(job):
    return compile_job(job, workers=2, trials=1000)


def test_compile_job_two_squares_are_sorted_by_one_squeeze(plan):
    assert plan.evaluation.squeezes.max() == 1
    assert plan.evaluation.success.mean() > 0.99
    assert loads(dumps(plan.table)) == plan.table


def test_identities_count_parts_by_true_and_stated_name(job, plan):
    result = evaluate(plan.table, job, ContactWorlds.of_job(job, 5), 2000, 5)
    named = identities(plan.table, result)
    assert named.named.sum() == 2000
    assert named.named[0].sum() / 2000 == pytest.approx(0.3, abs=0.04)
    assert named.right > 0.99
    assert np.trace(named.named) == result.success.sum()  # the goal is the name alone


def test_plan_compile_warns_of_one_hopeless_part_before_the_search(tmp_path, monkeypatch):
    def ended(*_):
        raise NoPlanError("no plan")

    monkeypatch.setattr(compile_command, "compile_job", ended)
    job = tmp_path / "job.toml"
    job.write_text(COMMON.replace("identity", "pose") + squares(20, 34) + "symmetry = 1\n")
    code, _, err = called(compile_command.main, job, "-o", tmp_path / "t.msgpack")
    assert (code, err.count("\n")) == (NoPlanError.exit_code, 2)
    assert "warning: large: no squeeze distinguishes" in err


def test_hardly_located_names_only_part_that_no_trial_locates(plan):
    small = plan.evaluation.traits["hypothesis"] == 0
    lost = replace(plan.evaluation, leaf=np.where(small, REJECTED, plan.evaluation.leaf))
    assert list(hardly_located(plan.evaluation)) == []
    (line,) = hardly_located(lost)
    assert line.startswith(f"small: located in 0.00% of its {small.sum()} trials")


def test_evaluate_exchanged_names_are_wrong_answers(plan):
    real = job_file.parse(COMMON + squares(34, 20))
    result = evaluate(plan.table, real, ContactWorlds.of_job(real, 5), 500, 5)
    assert result.wrong.mean() > 0.99


def test_tried_foreign_parts_are_counted_by_outcome(plan):
    entries = "".join(rectangle("stranger", side, side, side) for side in (20.2, 50, 57))
    job = job_file.parse(COMMON + squares(20, 34) + entries)

    def evaluated(part: job_file.Job) -> Evaluation:
        return evaluate(plan.table, part, ContactWorlds.of_job(part, 5), 400, 5, Threads(2))

    evaluation = evaluate(plan.table, job, ContactWorlds.of_job(job, 5), 2000, 5)
    alike, *others = tried(plan.table, job, evaluation, job.foreign_parts, evaluated)
    assert alike.answered > 0.9
    (answer,) = alike.answers
    assert (answer.part, answer.share) == ("small", alike.answered)
    assert 20.0 < answer.widths_mm[0] < 20.2 * 2**0.5 + 0.4  # from side to diagonal
    assert answer.apart_mm == pytest.approx(abs(answer.widths_mm[0] - answer.ours_mm[0]), abs=0.006)
    # At most the difference of the parts and the rounding of a reading.
    assert answer.apart_mm < 0.2 * 2**0.5 + COUNT_MM
    assert alike.lines()[1:] == [answer.line()]
    assert "as small" in answer.line()
    assert "mm of ours at every squeeze" in answer.line()
    assert alike.figures()["too_often"]
    assert json.loads(json.dumps(alike.figures()))["answers"][0]["apart_mm"] == answer.apart_mm
    assert [other.answered for other in others] == [0.0, 0.0]
    ends = others[0].evaluation  # a large part may already lie where the fingers come down
    assert (ends.rejected | (ends.leaf == CRASHED)).all()
    assert others[1].evaluation.crashes > 0  # its corners reach under the open fingers
    assert [(len(other.lines()), other.answers) for other in others] == [(1, ()), (1, ())]


def test_plan_evaluate_foreign_parts_are_generated_for_each_part(plan, tmp_path):
    """For each of the two squares: a smaller and a larger square, a disc and a rectangle."""
    tree = tmp_path / "squares.msgpack"
    dump(plan.table, tree)
    words = (tree, "--foreign-parts", "--trials", "200", "--json")
    code, out, _ = called(evaluate_command.main, *words)
    assert code == 0
    record = json.loads(out)["foreign_parts"]
    names = [f"small {kind}" for kind in ("x 0.9", "x 1.1", "its disc", "its rectangle")]
    assert [each["name"] for each in record][:4] == names
    assert len(record) == 8
    diagonal = 2.0 * 2**0.5
    assert record[1]["answers"][0]["differ_mm"] == pytest.approx(diagonal, abs=0.01)


def rectangle(key, name, length, width):
    corners = f"[0, 0], [{length}, 0], [{length}, {width}], [0, {width}]"
    return f'[[{key}]]\nname = "{name}"\n[{key}.part]\noutline_mm = [{corners}]\n'


def test_tried_foreign_part_alike_at_all_squeezes_states_difference():
    """Plates are squeezed only across, where a shorter plate reads like the job's plate."""
    common = COMMON.replace('orientation = "unknown"', "orientation_halfwidth_deg = 10")
    common = common.replace("[0, 45, 90, 135]", "[0]\nproposals = 'none'")
    ours = rectangle("hypothesis", "plate", 40, 20) + rectangle("hypothesis", "broad plate", 40, 30)
    job = job_file.parse(common + ours + rectangle("stranger", "short plate", 34, 20))
    table = compile_job(job, workers=1, trials=1000).table
    evaluation = evaluate(table, job, ContactWorlds.of_job(job, 5), 400, 5)

    def evaluated(part):
        return evaluate(table, part, ContactWorlds.of_job(part, 5), 400, 5)

    (short,) = tried(table, job, evaluation, job.foreign_parts, evaluated)
    first = short.answers[0]
    assert (first.part, short.often) == ("plate", True)
    assert first.apart_mm < 0.5
    assert first.differ_mm == pytest.approx(6.0, abs=0.1)  # along the plate
    assert "some width differs by 6.0 mm" in short.lines()[1]


def simulated(table, folder, *more):
    """Runs parts in virtual time; returns the exit code, the parts that `--json` prints, and the journal."""
    tree, journal = folder / "t.msgpack", folder / "journal"
    dump(table, tree)
    words = ("--tree", tree, *VIRTUAL, "--seed", "5", "--json", "--journal", journal)
    code, out, _ = called(cli.main, *words, *more)
    return code, [json.loads(line) for line in out.splitlines()], journal


@pytest.fixture(scope="module")
def ran(plan, tmp_path_factory):
    code, result, journal = simulated(plan.table, tmp_path_factory.mktemp("run"), "--count", "4")
    assert code == 0
    return result, journal


def test_grasp_runtime_several_parts_states_name_and_true_name(ran):
    result, journal = ran
    assert {part["hypothesis"] for part in result} == {"small", "large"}
    assert all(part["hypothesis"] == part["true_hypothesis"] for part in result)
    assert all(part["within_goal"] for part in result)
    recorded = [json.loads(line) for line in journal.read_text().splitlines()]
    names = [part["hypothesis"] for part in result]
    ends = [row["hypothesis"] for row in recorded if row["kind"] in ("outcome", "truth")]
    assert ends == [name for name in names for _ in range(2)]
    assert [row["hypothesis"] for row in rows(recorded)] == names  # one squeeze each


@pytest.mark.parametrize(
    ("program", "words", "message"),
    [
        (cli, "--tree TREE --port sim --deliver 50,0,0", "which part it is"),
        (report, "TREE -o page.html --bound", "--bound is for one part"),
        (evaluate_command, "TREE --foreign-parts --sweep", "leave out --ppm and --sweep"),
    ],
)
def test_command_option_for_one_part_is_refused_for_several(
    program, words, message, plan, tmp_path
):
    dump(plan.table, tmp_path / "TREE")
    places = {"TREE": tmp_path / "TREE", "page.html": tmp_path / "page.html"}
    refused = called(program.main, *(places.get(word, word) for word in words.split()))
    assert refused.code != 0
    assert refused.one_line
    assert message in refused.err


EVIL = "large <i>&"
JUDGE = """
import json, sys
for line in sys.stdin:
    asked = json.loads(line)
    known = asked["part"] == 0 or asked["hypothesis"] in sys.argv[1:]
    print(json.dumps({"verdict": "pass" if known else "fail", "hypothesis": "seen"}), flush=True)
"""


@pytest.fixture(scope="module")
def posed():
    entries = squares(20, 34).replace('"large"', f'"{EVIL}"')
    goal = COMMON.replace('kind = "identity"\ndistance_mm = 3.0', "distance_mm = 6.0")
    return compile_job(job_file.parse(goal + entries), workers=2, trials=500)


@pytest.mark.parametrize("planned", ["posed", "plan"])  # "plan" has a goal of kind "identity"
def test_grasp_runtime_asks_auditor_with_name_of_part(planned, request, tmp_path):
    table = request.getfixturevalue(planned).table
    (tmp_path / "judge.py").write_text(JUDGE)
    audit = f"{sys.executable} {tmp_path / 'judge.py'} small"
    _, result, journal = simulated(table, tmp_path, "--count", "6", "--audit", audit)
    result = [part for part in result if part["outcome"] == "leaf"]
    assert {part["hypothesis"] for part in result} == {part.name for part in table.hypotheses}
    assert all((part["audit"] == "pass") == (part["hypothesis"] == "small") for part in result)
    recorded = [json.loads(line) for line in journal.read_text().splitlines()]
    assert [r["hypothesis"] for r in recorded if r["kind"] == "audit"] == ["seen"] * len(result)


def test_grasp_runtime_audit_of_goal_that_leaves_open_the_part_is_refused(posed, tmp_path):
    goal = replace(posed.table.goal, identify=False)
    table = replace(posed.table, goal=goal, job=None)  # the job would contradict the goal
    dump(table, tmp_path / "t.msgpack")
    words = ("--tree", tmp_path / "t.msgpack", "--port", "sim", "--audit", "judge.py")
    refused = called(cli.main, *words)
    assert refused.code == 2
    assert "--audit judges which part it is" in refused.err


def test_from_table_several_parts_have_their_outlines_and_goals(posed, tmp_path):
    dump(posed.table, tmp_path / "t.msgpack")
    tags = [PartTag("small", 7, 22.0), PartTag(EVIL, 8, 22.0)]
    small, large = from_table(tmp_path / "t.msgpack", tags)
    assert [np.ptp(each.outline_mm[:, 0]) for each in (small, large)] == pytest.approx([20.0, 34.0])
    rho_um = [item.rho_um for item in posed.table.hypotheses]
    assert [each.goal.rho_um for each in (small, large)] == rho_um
    with pytest.raises(InputError, match="for no part of"):
        from_table(tmp_path / "t.msgpack", [PartTag("other", 7, 22.0)])


def report_of(table, folder, *more):
    """The report of a table: its text, its elements and its data."""
    tree, output = folder / "t.msgpack", folder / "page.html"
    dump(table, tree)
    assert report.main([str(tree), "-o", str(output), "--trials", "400", *more]) == 0
    text = output.read_text()
    page = Page(text)
    assert page.open == []
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    links = {attributes["href"][1:] for tag, attributes in page.elements if tag in ("a", "use")}
    assert links <= set(ids)
    return text, page, json.loads(page.scripts["data"])


def named_in(text):
    """The counts in the page's table of names, row by row; the last column counts parts without a name."""
    body = text.split('<table id="names">')[1].split("<tbody>")[1].split("</tbody>")[0]
    rows_of = re.findall(r"<tr>(.*?)</tr>", body)
    return [[int(count) for count in re.findall(r"<td>(?:<strong>)?(\d+)", row)] for row in rows_of]


def test_plan_report_several_parts_draws_and_counts_each(posed, tmp_path):
    text, page, data = report_of(posed.table, tmp_path)
    assert not [tag for tag, _ in page.elements if tag == "i"]
    assert "finds and names a part (small or large &lt;i&gt;&amp;)" in text
    assert data["parts"] is None  # no journal
    counted = np.array(named_in(text))
    assert counted.shape == (2, 3)
    # The figures of a report are those of the table's evaluation.
    trials = posed.table.predicted.trials
    assert counted.sum() == trials
    assert f"Of {trials} parts sent through the table" in text
    assert '<span class="s0">small</span> <span class="s1">large &lt;i&gt;&amp;</span>' in text
    assert counted[0].sum() / trials == pytest.approx(0.3, abs=0.12)
    assert np.trace(counted) >= 0.97 * counted[:, :2].sum()
    panels = re.findall(r'<button class="panel leaf"(.*?)</button>', text, re.DOTALL)
    assert len(panels) > 1
    for panel in panels:
        *drawn, answered = re.findall(r'href="(#part(?:-1)?)"', panel)
        assert drawn.count(answered) >= 0.8 * len(drawn)
    sides = {a["id"]: points for a, points in polygons(page)}
    assert np.ptp(sides["part"]) == pytest.approx(20.0, abs=0.02)
    assert np.ptp(sides["part-1"]) == pytest.approx(34.0, abs=0.02)


def polygons(page):
    """The outlines of parts in a page: attributes of each polygon, and x of its vertices [mm]."""
    return [
        (attributes, [float(point.split(",")[0]) for point in attributes["points"].split()])
        for tag, attributes in page.elements
        if tag == "polygon" and attributes.get("id", "").startswith("part")
    ]


def test_plan_report_identity_goal_shows_names_of_parts_and_journal(plan, ran, tmp_path):
    parts, journal = ran
    lines = [part["hypothesis"] for part in parts]
    text, _, data = report_of(plan.table, tmp_path, "--journal", str(journal))
    assert "x [mm]" not in text.split("<script")[0]
    assert "where the part lies is not asked for" in text.lower()
    assert np.trace(np.array(named_in(text))) > 0.97 * 400
    assert [entry["name"] for entry in data["parts"]] == lines
    assert all(f"{lines.count(name)} {name}" in text for name in set(lines))
    assert "4 of 4 parts named" in text
