"""The error classes and the list of exit codes in decision record 0003 agree."""

import importlib
import re
from pathlib import Path

import pytest

RECORD = Path(__file__).parents[2] / "tools" / "decisions" / "0003-one-list-of-exit-codes.md"
PACKAGES = ("planner", "runtime", "drivers")
ANY_PACKAGE = {1, 2}  # base classes, and arguments that argparse alone cannot judge
ROW = re.compile(r"^\| (?P<code>\d+) \| (?P<meaning>[^|]+) \| (?P<packages>[^|]+) \|$", re.MULTILINE)


def recorded() -> list[tuple[int, set[str]]]:
    """Exit codes in the order of the record, each with the packages that are said to raise it."""
    return [
        (int(row["code"]), set(re.findall(r"\w+", row["packages"])))
        for row in ROW.finditer(RECORD.read_text())
    ]


def raised_in(package: str) -> dict[str, int]:
    """Exit codes by class name: the package's errors module, and for runtime the table's own error."""
    modules = [f"{package}.errors"] + ["runtime.table"] * (package == "runtime")
    return {
        f"{module}.{name}": item.exit_code
        for module in modules
        for name, item in vars(importlib.import_module(module)).items()
        if isinstance(item, type) and issubclass(item, Exception) and hasattr(item, "exit_code")
    }


def test_record_lists_every_code_once_and_in_order() -> None:
    codes = [code for code, _ in recorded()]
    assert len(codes) > 10
    assert codes == sorted(set(codes))
    assert all(0 <= code < 126 or code == 130 for code in codes)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_error_of_a_package_has_a_recorded_code(package: str) -> None:
    allowed = {code for code, packages in recorded() if package in packages} | ANY_PACKAGE
    errors = raised_in(package)
    assert errors
    assert {name: code for name, code in errors.items() if code not in allowed} == {}


@pytest.mark.parametrize("package", PACKAGES)
def test_every_recorded_code_has_an_error_in_its_package(package: str) -> None:
    claimed = {code for code, packages in recorded() if package in packages}
    assert claimed - set(raised_in(package).values()) == set()
