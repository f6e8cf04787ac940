"""The error classes and the list of exit codes in decision record 0003 agree."""

import importlib
import re
from pathlib import Path

import pytest

RECORD = Path(__file__).parents[2] / "tools" / "decisions" / "0003-one-list-of-exit-codes.md"
ROW = re.compile(r"^\| (?P<code>\d+) \| [^|]+ \| (?P<raised_in>[^|]+) \|$", re.MULTILINE)
ANY_PACKAGE = {1, 2}  # base classes, and arguments that argparse alone cannot judge


def recorded() -> list[tuple[int, set[str]]]:
    """Exit codes in the order of the record, each with the packages that are said to raise it."""
    rows = ROW.finditer(RECORD.read_text(encoding="utf-8"))
    return [(int(row["code"]), set(re.findall(r"[a-z]+", row["raised_in"]))) for row in rows]


def exit_codes(package: str) -> dict[str, int]:
    """Exit codes of the classes in a package's errors module, by name."""
    return {
        name: item.exit_code
        for name, item in vars(importlib.import_module(f"{package}.errors")).items()
        if isinstance(item, type) and issubclass(item, Exception) and hasattr(item, "exit_code")
    }


def test_record_lists_every_code_once_and_in_order() -> None:
    codes = [code for code, _ in recorded()]
    assert set(codes) > ANY_PACKAGE
    assert codes == sorted(set(codes))
    assert all(0 <= code < 126 or code == 130 for code in codes)


@pytest.mark.parametrize("package", ["planner", "runtime", "drivers"])
def test_errors_of_a_package_have_the_recorded_codes(package: str) -> None:
    raised = set(exit_codes(package).values())
    assert raised - ANY_PACKAGE == {code for code, packages in recorded() if package in packages}
