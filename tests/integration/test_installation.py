"""An installation loads no heavy library for a cell, names missing extras and ignores foreign packages."""

import sys
from pathlib import Path

import pytest
from programs import REHEARSAL, TABLE, VIRTUAL, ended

HEAVY = ("numpy", "scipy", "numba", "sklearn", "cv2", "planner.job.model", "runtime.plc")
HEAVY += ("asyncua", "cryptography", "zipfile", "importlib.metadata", "runtime.signing")
HEAVY += ("runtime.monitoring.live",)
CHECK = f"import sys; print([name for name in {HEAVY} if name in sys.modules])"


def loaded_after(code: str) -> str:
    """Returns, as the text of a list, the modules of `HEAVY` that some code loads in a new interpreter."""
    done = ended([sys.executable, "-c", f"{code}\n{CHECK}"])
    assert done.code == 0, done.err
    assert "\x1b" not in done.out  # colours are for a terminal
    return done.out.splitlines()[-1]


def test_grasp_runtime_run_and_check_load_no_heavy_module(tree, tmp_path):
    words = ["--tree", str(tree), "--journal", str(tmp_path / "journal.jsonl")]
    real, virtual = (*words, "--port", "sim", "--time-scale", "60"), (*words, *VIRTUAL, *REHEARSAL)
    code = f"import runtime.cli\nfor words in {real!r}, {virtual!r}:\n"
    code += "    assert runtime.cli.main([*words]) in (0, 10)\n"
    code += f"assert runtime.cli.main(['--tree', {str(tree)!r}, '--check']) == 0"
    assert loaded_after(code) == "[]"


def test_plc_command_import_loads_no_opc_ua_library() -> None:
    code = "import runtime.commands.plc\nfrom sys import modules\n"
    code += "del modules['runtime.plc'], modules['runtime.monitoring.live']"
    assert loaded_after(code) == "[]"


def test_loaded_after_heavy_import_names_module() -> None:
    numpy = "import sys, types; sys.modules['numpy'] = types.ModuleType('numpy')"
    assert loaded_after(numpy) == "['numpy']"


SIGNED = f"--tree {TABLE} --check --require-signed {TABLE}"
PLANNER = "compile_job simulate evaluate expect identify report init studio try_part"
CALLS = [
    *(("numpy", f"planner.commands:{command}", "", "planner") for command in PLANNER.split()),
    ("cv2", "drivers.camera.commands:audit", "['judge']", "audit"),
    ("cv2", "drivers.camera.commands:calibrate", "['camera']", "audit"),
    ("cv2", "drivers.sim.cli:main", f"['--tree', {str(TABLE)!r}, '--camera']", "audit"),
    ("cryptography", "runtime.cli:main", f"{SIGNED!r}.split()", "evidence"),
    ("shtab", "runtime.commands.squeezetree:main", "['--print-completion', 'bash']", "completion"),
]
EACH = """
import contextlib, importlib, io, sys
for blocked, target, given, extra in CALLS:
    sys.modules[blocked], kept = None, sys.modules.get(blocked)
    module, _, function = target.partition(":")
    said, code = io.StringIO(), None
    with contextlib.redirect_stderr(said):
        try:
            code = getattr(importlib.import_module(module), function)(*([eval(given)] if given else []))
        except SystemExit as end:
            code = end.code
    assert code == 2, (target, code)
    assert said.getvalue().count("\\n") == 1, said.getvalue()
    assert f"squeezetree[{extra}]" in said.getvalue(), said.getvalue()
    del sys.modules[blocked]
for word in ("report", "study"):
    sys.modules["numpy"] = sys.modules["cv2"] = None
    assert importlib.import_module("drivers.camera.commands").audit([word, "none.jsonl"]) == 24
"""


def test_commands_without_library_name_extra_in_one_line():
    """`grasp-audit report` and `grasp-audit study` need neither numpy nor OpenCV."""
    code, _, err = ended([sys.executable, "-c", f"CALLS = {CALLS!r}\n{EACH}"])
    assert code == 0, err
    assert err.count("none.jsonl") == 2


def test_planner_gym_without_gymnasium_names_extra():
    code = "import sys; sys.modules['gymnasium'] = None; import planner.gym"
    _, _, err = ended([sys.executable, "-c", code])
    assert "pip install 'squeezetree[gym]'" in err.splitlines()[-1]


WORLD = "from runtime.shell.worlds import find_factory; find_factory('planner.world:make')"
RUN = "--tree small.msgpack --journal journal.jsonl --port sim --time-scale 20"


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("plan-init", ["--help"]),
        ("grasp-audit", ["--help"]),
        (Path(sys.executable).name, ["-P", "-c", WORLD]),
        # This run starts a cell, too.
        ("grasp-runtime", [*RUN.split(), *REHEARSAL]),
    ],
)
def test_command_beside_foreign_packages_starts(program, words, tree, tmp_path):
    for package in ("planner", "runtime", "drivers"):
        (tmp_path / package).mkdir()
        foreign = "raise SystemExit('a foreign module was imported')\n"
        (tmp_path / package / "__init__.py").write_text(foreign)
    done = ended([Path(sys.executable).with_name(program), *words], cwd=tmp_path)
    assert done.code == 0, done.err
