"""The entry points of the planner's commands; without the planner extra they say what to install."""

from collections.abc import Callable
from functools import partial

from runtime.shell.command import entry


def _command(name: str, module: str = "") -> Callable[[], int]:
    """The entry point of `plan-<name>`: `main` of `planner.cli.<module>`, by default of its own name."""
    return partial(entry, f"plan-{name}", f"planner.cli.{module or name}", "planner")


compile_job = _command("compile")
simulate = _command("simulate")
evaluate = _command("evaluate")
expect = _command("expect")
export = _command("export")
identify = _command("identify")
refit = _command("refit")
report = _command("report")
init = _command("init")
try_part = _command("try", "first_look")
