"""The entry points of the planner's commands; without the planner extra they say what to install."""

from __future__ import annotations

import sys
from importlib import import_module

USAGE = 2


def _run(command: str) -> int:
    """Imports and runs `planner.cli.<command>`; one line and exit code 2 without the planner extra."""
    try:
        module = import_module(f"planner.cli.{command}")
    except ModuleNotFoundError as error:
        if (error.name or "planner").split(".")[0] in {"planner", "runtime"}:
            raise
        hint = "install it with: pip install 'squeezetree[planner]'"
        print(f"plan-{command}: needs the planner extra ({error.name} is missing); {hint}", file=sys.stderr)
        return USAGE
    return int(module.main())


def compile_job() -> int:
    """plan-compile."""
    return _run("compile")


def simulate() -> int:
    """plan-simulate."""
    return _run("simulate")


def evaluate() -> int:
    """plan-evaluate."""
    return _run("evaluate")


def expect() -> int:
    """plan-expect."""
    return _run("expect")


def identify() -> int:
    """plan-identify."""
    return _run("identify")


def report() -> int:
    """plan-report."""
    return _run("report")


def init() -> int:
    """plan-init."""
    return _run("init")
