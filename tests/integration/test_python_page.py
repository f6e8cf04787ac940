"""The page about Python: its examples run as written, and planner.api keeps the names that it promises."""

import doctest
import inspect
import re
import shutil

from documents import DOCS, ROOT

import planner.api

PAGE = (DOCS / "python.md").read_text()
CALLS = {
    "Belief.of": "poses",
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
    "Simulator.sample": "self, n, rng",
    "Table.load": "path",
    "Table.lookup": "self, nodes, counts",
    "Table.of": "record",
    "Table.save": "self, path",
    "World.squeeze": "self, pose_hand",
    "compile": "job, workers, trials, report, limit, store, scheduler",
    "evaluate": "table, job, world, trials, seed, workers, report",
    "squeeze": "job, belief, placement, rng, workers",
}


def test_the_examples_print_what_the_page_says(tmp_path, monkeypatch):
    for name in ("job.toml", "rectangle.msgpack"):
        shutil.copy(ROOT / "trees" / "rectangle" / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    code = "".join(re.findall(r"^```pycon\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
    examples = doctest.DocTestParser().get_doctest(code, {}, "python.md", None, 0)
    printed: list[str] = []
    assert doctest.DocTestRunner().run(examples, out=printed.append).failed == 0, "".join(printed)
    assert len(examples.examples) > 40


def test_the_names_and_their_arguments_stay():
    assert sorted(planner.api.__all__) == sorted({name.partition(".")[0] for name in CALLS} | {"Plan"})
    for name, arguments in CALLS.items():
        found = planner.api
        for step in name.split("."):
            found = getattr(found, step)
        assert ", ".join(inspect.signature(found).parameters) == arguments, name


def test_every_name_is_on_the_page():
    assert [name for name in planner.api.__all__ if not re.search(rf"`{name}\b", PAGE)] == []
