"""The cell controller runs without the planner's libraries: on import, and after a whole simulated run."""

import sys
from pathlib import Path

from programs import ended

HEAVY = ("numpy", "scipy", "numba", "sklearn", "cv2", "planner.job.model", "runtime.plc")
HEAVY += ("asyncua", "cryptography", "zipfile", "importlib.metadata", "runtime.signing")
CHECK = f"import sys; print([name for name in {HEAVY} if name in sys.modules])"


def loaded_after(code: str) -> str:
    """What of HEAVY a fresh interpreter has loaded after some code; the last line it prints."""
    done = ended([sys.executable, "-c", f"{code}\n{CHECK}"])
    assert done.code == 0, done.err
    return done.out.splitlines()[-1]


def test_a_run_and_a_check_load_nothing_heavy(tree: Path, tmp_path: Path) -> None:
    words = ["--tree", str(tree), "--port", "sim", "--time-scale", "60"]
    words += ["--journal", str(tmp_path / "journal.jsonl")]
    code = f"import runtime.cli\nassert runtime.cli.main({words!r}) in (0, 10)\n"
    code += f"assert runtime.cli.main(['--tree', {str(tree)!r}, '--check']) == 0"
    assert loaded_after(code) == "[]"


def test_modbus_loads_nothing_of_opc_ua() -> None:
    assert loaded_after("import runtime.commands.plc, sys; del sys.modules['runtime.plc']") == "[]"


def test_the_check_would_see_it() -> None:
    numpy = "import sys, types; sys.modules['numpy'] = types.ModuleType('numpy')"
    assert loaded_after(numpy) == "['numpy']"
