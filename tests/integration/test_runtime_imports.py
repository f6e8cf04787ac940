"""The cell controller runs without the planner's libraries: on import, and after a whole simulated run."""

import subprocess
import sys
from pathlib import Path

from sample_tables import small_table

from runtime.table import dump

ROOT = Path(__file__).parents[2]
HEAVY = ("numpy", "scipy", "numba", "sklearn", "cv2", "planner.job.model", "runtime.plc")
HEAVY += ("asyncua", "cryptography", "zipfile", "importlib.metadata", "runtime.signing")
CHECK = f"import sys; print([name for name in {HEAVY} if name in sys.modules])"


def loaded_after(code: str) -> str:
    """What of HEAVY a fresh interpreter has loaded after some code; the last line it prints."""
    words = [sys.executable, "-c", f"{code}\n{CHECK}"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout.splitlines()[-1]


def test_a_run_and_a_check_load_nothing_heavy(tmp_path: Path) -> None:
    tree, journal = tmp_path / "small.msgpack", tmp_path / "journal.jsonl"
    dump(small_table(), tree)
    words = ["--tree", str(tree), "--port", "sim", "--time-scale", "60", "--journal", str(journal)]
    code = f"import runtime.cli\nassert runtime.cli.main({words!r}) in (0, 10)\n"
    code += f"assert runtime.cli.main(['--tree', {str(tree)!r}, '--check']) == 0"
    assert loaded_after(code) == "[]"


def test_modbus_loads_nothing_of_opc_ua() -> None:
    assert loaded_after("import runtime.commands.plc, sys; del sys.modules['runtime.plc']") == "[]"


def test_the_check_would_see_it() -> None:
    numpy = "import sys, types; sys.modules['numpy'] = types.ModuleType('numpy')"
    assert loaded_after(numpy) == "['numpy']"
