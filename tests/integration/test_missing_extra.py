"""Where only the cell's part is installed, commands that need more name the extra."""

import sys

from programs import TABLE, ended

PLANNER = "compile_job simulate evaluate expect identify report init studio try_part"
CALLS = [
    *(("numpy", f"planner.commands:{command}", "", "planner") for command in PLANNER.split()),
    ("cv2", "drivers.camera.commands:audit", "['judge']", "audit"),
    ("cv2", "drivers.camera.commands:calibrate", "['camera']", "audit"),
    ("cv2", "drivers.sim.cli:main", f"['--tree', {str(TABLE)!r}, '--camera']", "audit"),
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


def test_without_its_library_each_command_names_the_extra_in_one_line():
    """Report and study of audits need neither numpy nor OpenCV."""
    code, _, err = ended([sys.executable, "-c", f"CALLS = {CALLS!r}\n{EACH}"])
    assert code == 0, err
    assert err.count("none.jsonl") == 2


def test_without_gymnasium_the_environment_names_its_extra():
    code = "import sys; sys.modules['gymnasium'] = None; import planner.gym"
    _, _, err = ended([sys.executable, "-c", code])
    assert "pip install 'squeezetree[gym]'" in err.splitlines()[-1]
