"""The page about Python: its examples run as written, and planner.api keeps the names that it promises."""

import doctest
import inspect
import json
import os
import re
import shutil

import matplotlib
import pytest
from documents import DOCS, blocks, run, shims
from matplotlib import pyplot
from programs import JOB, ROOT, TABLE, TREES, VIRTUAL

import planner.api
from drivers.sim.physics import scene
from planner.api import ContactWorld, Job, Limit
from runtime.shell.errors import UsageError

NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
EACH_NOTEBOOK = pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
QUICK = {"search": {"particles": 200}}
PAGE = (DOCS / "python.md").read_text()
CALLS = {
    "Belief.of": "poses, reading, traits",
    "ContactWorld": "job, seed, workers",
    "ContactWorld.squeeze": "self, pose_hand",
    "ContactWorld.squeeze_many": "self, poses_hand, traits",
    "ContactWorld.push": "self, pose_hand, opening_mm, way_mm",
    "Job.load": "path, changes",
    "Job.replaced": "self, where, changes",
    "Limit": "budget_s, clock",
    "Limit.ask": "self",
    "Pomdp.initial": "self, n, rng",
    "Pomdp.likelihood": "self, o, s, a",
    "Pomdp.of_job": "job, workers",
    "Pomdp.sample": "self, s, a, rng",
    "Pomdp.updated": "self, belief, a, o, rng",
    "Simulator.nominal": "self, n, mu",
    "Simulator.of_job": "job, workers, step_mm",
    "Simulator.roll_out": "self, poses, parameters",
    "Simulator.sample": "self, n, rng, traits",
    "Table.load": "path",
    "Table.lookup": "self, nodes, widths_mm",
    "Table.of": "record",
    "Table.save": "self, path",
    "World.squeeze": "self, pose_hand",
    "compile": "job, workers, trials, report, limit, scheduler",
    "evaluate": "table, job, world, trials, seed, workers, report",
    "squeeze": "job, belief, placement, rng, workers",
}


def test_python_page_examples_print_shown_output(tmp_path, monkeypatch):
    for file in (JOB, TABLE):
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    code = "".join(re.findall(r"^```pycon\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
    examples = doctest.DocTestParser().get_doctest(code, {}, "python.md", None, 0)
    printed: list[str] = []
    assert doctest.DocTestRunner().run(examples, out=printed.append).failed == 0, "".join(printed)
    assert len(examples.examples) > 40


def test_planner_api_names_and_arguments_are_stable():
    names = {name.partition(".")[0] for name in CALLS} | {"Plan"}
    assert sorted(planner.api.__all__) == sorted(names)
    for name, arguments in CALLS.items():
        result = planner.api
        for step in name.split("."):
            result = getattr(result, step)
        assert ", ".join(inspect.signature(result).parameters) == arguments, name


def test_python_page_contains_all_names_of_planner_api():
    assert [name for name in planner.api.__all__ if not re.search(rf"`{name}\b", PAGE)] == []


def test_planner_api_compile_report_may_cut_short_or_abort():
    job = Job.load(JOB, QUICK)
    limit = Limit()

    def grown(stage, *_):
        if stage == "search" and limit.standing:
            limit.ask()

    plan = planner.api.compile(job, trials=100, report=grown, limit=limit)
    assert plan.cut is not None
    assert plan.cut.asked

    def enough(*_):
        raise InterruptedError

    with pytest.raises(InterruptedError):
        planner.api.compile(job, trials=100, report=enough)


@EACH_NOTEBOOK
def test_notebooks_are_stored_without_output(notebook):
    for cell in json.loads(notebook.read_text())["cells"]:
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)


@EACH_NOTEBOOK
def test_notebooks_run_without_error(notebook, monkeypatch, capsys):
    """Executes the code of a notebook in this process and in the notebook's folder, without Jupyter."""
    matplotlib.use("Agg")
    monkeypatch.chdir(notebook.parent)
    monkeypatch.setattr(pyplot, "show", lambda: pyplot.close("all"))
    names = {"__name__": notebook.stem}
    for cell in json.loads(notebook.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), notebook.name, "exec"), names)


def test_notebook_world_is_loaded_by_plan_evaluate_and_grasp_runtime(tmp_path):
    """The notebook's command evaluates the world, and grasp-runtime runs a part in it."""
    cells = ["".join(cell["source"]) for cell in json.loads(NOTEBOOKS[-1].read_text())["cells"]]
    (tmp_path / "worn.py").write_text(documented_worlds()["notebook"])
    (tmp_path / "page.md").write_text(cells[-1])
    (block,) = blocks(tmp_path / "page.md")
    shutil.copytree(TREES / "rectangle", tmp_path / "trees" / "rectangle")
    path = f"{shims(tmp_path / 'bin')}:{os.environ['PATH']}"
    runtime = f"grasp-runtime --tree trees/rectangle/rectangle.msgpack {' '.join(VIRTUAL)}"
    commands = [f"{block.commands[0]} --trials 100"]
    commands.append(f"{runtime} --world worn:Worn --json || test $? -eq 10")
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    (printed, _) = run([block._replace(commands=commands)], tmp_path, environment)
    assert any("success" in line for line in printed)
    assert json.loads(printed[-1])["path"][0] == 0


def documented_worlds():
    """The world of the page, that of the notebook, and that of the page without the argument `traits`."""
    page = re.search(r"^>>> class Worn.*?(?=^>>> worn)", PAGE, re.DOTALL | re.MULTILINE)[0]
    of_page = "\n".join(line[4:] for line in page.splitlines())
    cells = ["".join(cell["source"]) for cell in json.loads(NOTEBOOKS[-1].read_text())["cells"]]
    of_notebook = next(cell for cell in cells if "class Worn" in cell)
    without_traits = of_page.replace(", traits=None", "").replace(", traits", "")
    header = "from planner.api import ContactWorld\n"
    return {
        "page": header + of_page,
        "notebook": of_notebook,
        "without_traits": header + without_traits,
    }


@pytest.mark.parametrize("name", documented_worlds())
def test_documented_worlds_run_in_a_simulated_cell(name, tmp_path, monkeypatch):
    (tmp_path / f"worn_{name}.py").write_text(documented_worlds()[name])
    monkeypatch.syspath_prepend(tmp_path)
    setting = scene.load(TABLE, None, f"worn_{name}:Worn")
    scene.warm_up(setting, 3)
    pose = (1.0, 2.0, 0.3)
    worlds = (make(setting.subject, 3) for make in (setting.factory, ContactWorld))
    worn, sound = (world.squeeze(pose) for world in worlds)
    assert worn[1] == pytest.approx(sound[1] + 0.5)
    doubting = setting.subject.replaced(doubt={"finger_share": [0.0, 0.1]})
    if name == "without_traits":
        said = r"worn_without_traits:Worn: squeeze\(\) failed: TypeError"
        with pytest.raises(UsageError, match=said):
            scene.warm_up(setting._replace(subject=doubting), 3)
    else:
        scene.warm_up(setting._replace(subject=doubting), 3)
