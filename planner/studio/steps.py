"""The steps of planning in the studio: commands in sequence, in a process that outlives the page.

`python -m planner.studio.steps NAME DRAWING ARGUMENT ...` runs `squeezetree try`, `report` and `run` in the
current folder, and then the trials of `planner.studio.what_if`; its output is the plan's log. The file
`NAME.stop` acts as Ctrl-C.
"""

import contextlib
import json
import shlex
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path

from planner.studio.what_if import trials_of

POLL_S = 0.2
PARTS = 20
PYTHON = [sys.executable, "-P", "-m"]  # never imports modules from the project folder
COMMAND = [*PYTHON, "runtime.commands.squeezetree"]
FILMED = "planner.studio.film:make"
PICTURE = ".look.svg"  # suffix


def written_for(name: str) -> dict[str, str]:
    """Names of the files that belong to a plan, by kind; the drawing is not among them."""
    suffixes = {
        "log": ".plan.jsonl",
        "job": ".toml",
        "table": ".msgpack",
        "picture": PICTURE,
        "report": ".html",
        "journal": ".journal.jsonl",
        "stop": ".stop",
        "trials": ".what-if",
    }
    return {what: name + suffix for what, suffix in suffixes.items()}


def commands_of(name: str, drawing: str, arguments: Sequence[str]) -> list[list[str]]:
    """The commands of a plan, each as its words after `squeezetree`: try, report, run of simulated parts."""
    files = {what: beginning(file) for what, file in written_for(name).items()}
    simulated = ["--port", "sim", "--time-scale", "max", "--count", str(PARTS)]
    return [
        ["try", beginning(drawing), *arguments, "-o", files["job"]],
        ["report", files["table"], "-o", files["report"]],
        ["run", "--tree", files["table"], *simulated, "--journal", files["journal"]],
    ]


def beginning(name: str) -> str:
    """A file's name as an argument that is never taken for an option."""
    return f"./{name}" if name.startswith("-") else name


def typed(words: Sequence[str]) -> str:
    """The command line that a user would type in a shell for the words of a command."""
    split = (word.split("=", 1) if word[:2] == "--" else [word] for word in words)
    return shlex.join(["squeezetree", *chain.from_iterable(split)])


def main(argv: Sequence[str]) -> int:
    """Runs the commands in turn, and then the what-if trials (`planner.studio.what_if`).

    Stops after a command that fails or leaves no table.

    Returns:
        The exit code of the last command before the trials.
    """
    name, drawing, *arguments = argv
    files = written_for(name)
    code = 0
    more = {"try": ["--follow"], "run": ["--world", FILMED]}
    for words in commands_of(name, drawing, arguments):
        _say(drawing=drawing, step=words[0], command=typed(words))
        code = _ended([*words, "--json", *more.get(words[0], [])], files["stop"])
        with contextlib.suppress(OSError):
            Path(files["stop"]).unlink(missing_ok=True)  # the next command starts nevertheless
        if code or not Path(files["table"]).exists():
            break
    _say(exit=code)
    if not code and Path(files["table"]).exists():
        try_others(files)
    return code


def try_others(files: Mapping[str, str]) -> None:
    """Runs the what-if trials of a plan, and logs each result.

    Ends early if a trial leaves no result, or once the file `files["stop"]` exists, which is then deleted.
    """
    stop, summary = Path(files["stop"]), Path(files["trials"]) / "summary.json"
    for trial in trials_of(Path(files["job"])):
        for value in trial.values:
            summary.unlink(missing_ok=True)
            words = trial.command(value, beginning(files["job"]), beginning(files["trials"]))
            _ended([*words, "--json"], files["stop"], aside=True)
            if stop.exists() or not summary.exists():
                return stop.unlink(missing_ok=True)
            result = trial.result(value, summary)
            _say(**result, command=typed(words))
            if not result["enough"]:
                break
    return None


def _ended(words: Sequence[str], stop: str, *, aside: bool = False) -> int:
    """Runs a command and returns its exit code; interrupts it, as Ctrl-C does, once the file `stop` exists.

    With `aside`, the command runs at low priority and its output is discarded.
    """
    before, output = (["nice"], subprocess.DEVNULL) if aside else ([], None)
    child = subprocess.Popen(
        [*before, *COMMAND, *words], stdin=subprocess.DEVNULL, stdout=output, stderr=output
    )
    asked = False
    while True:
        try:
            return child.wait(POLL_S)
        except subprocess.TimeoutExpired:
            if Path(stop).exists() and not asked:
                child.send_signal(signal.SIGINT)
                asked = True


def _say(**words: object) -> None:
    print(json.dumps(words), flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
