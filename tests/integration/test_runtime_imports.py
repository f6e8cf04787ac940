"""The cell controller runs without the planner's libraries: on import, and after a whole simulated run."""

import subprocess
import sys
from pathlib import Path

from sample_tables import small_table

from runtime.table import dump

ROOT = Path(__file__).parents[2]
HEAVY = ("numpy", "scipy", "numba", "sklearn", "cv2", "planner.job.model", "runtime.plc")
HEAVY += ("asyncua", "cryptography")
CHECK = f"import sys; print([name for name in {HEAVY} if name in sys.modules])"


def loaded_after(code: str) -> str:
    """What of HEAVY a fresh interpreter has loaded after some code; the last line it prints."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{CHECK}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return done.stdout.splitlines()[-1]


def test_importing_the_command_loads_nothing_heavy() -> None:
    assert loaded_after("import runtime.cli") == "[]"


def test_a_run_loads_nothing_heavy(tmp_path: Path) -> None:
    tree, journal = tmp_path / "small.msgpack", tmp_path / "journal.jsonl"
    dump(small_table(), tree)
    arguments = [
        "--tree",
        str(tree),
        "--port",
        "sim",
        "--time-scale",
        "60",
        "--journal",
        str(journal),
    ]
    code = f"import runtime.cli\nassert runtime.cli.main({arguments!r}) in (0, 10, 11)"
    assert loaded_after(code) == "[]"


def test_modbus_loads_nothing_of_opc_ua() -> None:
    assert loaded_after("import runtime.commands.plc, sys; del sys.modules['runtime.plc']") == "[]"


def test_the_check_would_see_it() -> None:
    assert (
        loaded_after("import sys, types; sys.modules['numpy'] = types.ModuleType('numpy')")
        == "['numpy']"
    )
