"""The entry points of the planner's commands; without the planner extra they say what to install."""

from __future__ import annotations

from runtime.shell.command import entry


def _run(command: str) -> int:
    """Runs `planner.cli.<command>`."""
    return entry(f"plan-{command}", f"planner.cli.{command}", "planner")


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
