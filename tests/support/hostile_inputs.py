"""Gives every command files that are almost right; `tools/hostile inputs` runs this.

A case is a command and a sound file with one or a few changes. The command must end with an exit code that
its --help lists, other than that of an internal error. If it fails, it must print a line on standard error
that names the command, and no traceback. It must not change the file, or leave a draft beside it. A command
that hangs is killed.

`run(seed, numbers)` judges the cases of some numbers; seed and number determine a case.
"""

import base64
import contextlib
import dataclasses
import hashlib
import importlib
import json
import multiprocessing
import os
import re
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random

import fuzz_tables
from calibrations import linear
from hostile_changes import journal, sealed, text, values
from programs import JOB, ROOT, TABLE, Ended, called, ended
from run_logs import chained
from sample_tables import small_table, with_job
from written_journals import write_run

from runtime.spc.expectation import KIND, VERSION
from runtime.table import dumps, load, loads
from runtime.table.codec import encode

LONGEST_S = 120.0  # time after which a case hangs; long, since the machine may have other work
PROCESS_EVERY = 150  # one case in so many runs as a process
INTERNAL = 1
ALARM = 11  # exit code of an alarm of grasp-audit report, which is no error


INIT, SIMULATE, COMPILE, IDENTIFY, EVALUATE, REFIT, REPORT = (
    (f"planner.cli.{name}", "main")
    for name in ("init", "simulate", "compile", "identify", "evaluate", "refit", "report")
)
RUNTIME, CELL = ("runtime.cli", "main"), ("drivers.sim.cli", "main")
JOURNAL, AUDIT = ("runtime.commands.journal", "main"), ("runtime.spc.command", "main")
TAG = ("drivers.camera.calibration.command", "main")
CALIBRATE = ("runtime.cli", "calibrate")
PARSERS = {
    RUNTIME: "runtime.commands.arguments",
    CALIBRATE: "runtime.commands.calibrate",
}  # modules of the parsers that are not in the module of their command
LOOKS = (
    "show {j}",
    "show {j} --json --since 2026-01-01 --outcome leaf",
    "verify {j}",
    "replay {j} --json",
    "export {j} -o o.csv",
)


@dataclasses.dataclass(frozen=True, slots=True)
class Kind:
    """A command, and the files from which its cases are made.

    Attributes:
        entry: module and function of the command.
        words: arguments of the command; `{name}` stands for a file.
        files: sound files by name, each with the function that changes it.
        keep: files by name that stay unchanged.
        share: relative frequency of the kind.
    """

    entry: tuple[str, str]
    words: str
    files: dict[str, tuple[bytes, Callable[[bytes, Random], bytes]]]
    keep: dict[str, bytes] = dataclasses.field(default_factory=dict)
    share: int = 1


@dataclasses.dataclass(frozen=True, slots=True)
class Case:
    """A command with its files, ready to run in an empty folder."""

    entry: tuple[str, str]
    words: tuple[str, ...]
    files: dict[str, bytes]


def table(data: bytes, random: Random) -> bytes:
    """Returns a mutated table, mostly with a right digest, or a sound table that embeds a changed job.

    `data` is not used.
    """
    if random.random() < 0.6:
        return fuzz_tables.mutant(random.randrange(1 << 30), 0)[1]
    job = text(job_text(), random) if random.random() < 0.5 else values(job_text(), random)
    return encode(with_job(load(TABLE).table, job.decode("utf-8", "replace")))


@cache
def job_text() -> bytes:
    """Returns the rectangle's job in the form in which tables embed it."""
    from planner.job import model as job

    return job.load(JOB).canonical().encode()


@cache
def kinds() -> tuple[Kind, ...]:
    """All kinds of cases."""
    job, small = JOB.read_bytes(), dumps(small_table())
    asked = "{j.toml} --poses {p} -o o.csv"
    runs, whole = recorded()
    init = "-o o.toml --radius 10 --gripper robotiq-2f-85 --fingers rubber"
    tag = "tag --part p --number 7 --side 20 --calibration {c} --poses {p} -o o.json"
    reports, check = "{t} -o o.html --trials 20", "--tree {t} --check"
    surface = "-o o.toml --splits 2 --kind ellipsoid"
    middle = "middle --port no.tty --arm tcp://127.0.0.1:9 --tree {t} --calibration {c} --block 21"
    middle += " --tips straight -o o.json"
    return (
        Kind(INIT, f"{{f.dxf}} --units mm {init}", {"f.dxf": (lever(), text)}, {}, 2),
        Kind(INIT, f"{{f.svg}} {init}", {"f.svg": (SVG, text)}, {}, 2),
        Kind(INIT, f"{{f.csv}} {init}", {"f.csv": (OUTLINE, text)}, {}, 2),
        Kind(INIT, f"{{f.stl}} --units mm {init}", {"f.stl": (STL, text)}, {}, 2),
        Kind(SIMULATE, asked, {"j.toml": (job, text)}, {"p": POSES}, 4),
        Kind(SIMULATE, asked, {"p": (POSES, text)}, {"j.toml": job}, 2),
        Kind(COMPILE, "{j.toml} --baseline sensorless --trials 20", {"j.toml": (job, text)}, {}, 2),
        Kind(IDENTIFY, f"{{l.csv}} {surface}", {"l.csv": (pairs(), text)}, {}, 2),
        Kind(IDENTIFY, f"{{l.txt}} {surface}", {"l.txt": (PUSHES, text)}, {}, 2),
        Kind(EVALUATE, "{t} --trials 20 --workers 1", {"t": (small, table)}, {}, 2),
        Kind(REFIT, "{j.toml} --journal {l} -o o.toml", {"l": (runs, journal)}, {"j.toml": job}),
        Kind(REPORT, reports, {"t": (small, table)}),
        Kind(REPORT, f"{reports} --journal {{j}}", {"j": (runs, journal)}, {"t": whole}),
        Kind(RUNTIME, check, {"t": (small, table)}, {}, 5),
        Kind(RUNTIME, f"{check} --calibration {{c}}", {"c": (gauged(), sealed)}, {"t": small}, 3),
        Kind(CALIBRATE, middle, {"t": (small, table)}, {"c": gauged()}, 2),
        Kind(CALIBRATE, middle, {"c": (gauged(), sealed)}, {"t": small}, 2),
        Kind(
            RUNTIME, f"{check} --deliver {{d.toml}}", {"d.toml": (DELIVERY, text)}, {"t": small}, 2
        ),
        *(Kind(JOURNAL, words, {"j": (runs, journal)}, {}, 2) for words in LOOKS),
        Kind(AUDIT, "{j} -o o.html --export o.csv", {"j": (runs, journal)}, {}, 4),
        Kind(AUDIT, "{j} --expected {e}", {"e": (readings(whole), values)}, {"j": runs}, 2),
        Kind(TAG, tag, {"c": (lens(), sealed)}, {"p": TOUCHED}, 2),
        Kind(TAG, tag, {"p": (TOUCHED, text)}, {"c": lens()}),
        Kind(CELL, "--tree none --faults {f.toml}", {"f.toml": (FAULTS, text)}),
    )


def recorded() -> tuple[bytes, bytes]:
    """Returns a journal of two runs, and the file of their table: the small table with a job embedded."""
    limits = load(TABLE).table.limits
    whole = dumps(with_job(replace(small_table(), limits=limits), job_text().decode()))
    with tempfile.TemporaryDirectory() as name:
        path = write_run(write_run(Path(name) / "j.jsonl"))
        entries = [json.loads(line) for line in path.read_bytes().splitlines()]
    for entry in entries:
        if entry["kind"] == "header":
            entry["table_base64"] = base64.b64encode(whole).decode()
            entry["table_sha256"] = hashlib.sha256(whole).hexdigest()
    return chained(entries), whole


def readings(whole: bytes) -> bytes:
    """Returns a document that `plan-expect` might write for a table; `whole` is the table's file."""
    seen = [{"132": 20}, {"150": 9}]
    worlds = [{"name": name, "readings": seen} for name in ("as planned", "less")]
    record = {"kind": KIND, "version": VERSION, "worlds": worlds}
    record["bins"] = loads(whole).gripper.bins
    return json.dumps({**record, "table_sha256": hashlib.sha256(whole).hexdigest()}).encode()


def lens() -> bytes:
    """A camera's calibration as `grasp-calibrate camera` writes it."""
    from cameras import camera, true_calibration

    from drivers.camera.calibration import file as calibration

    with tempfile.TemporaryDirectory() as name:
        calibration.save(true_calibration(camera()), Path(name) / "c.json")
        return (Path(name) / "c.json").read_bytes()


def lever() -> bytes:
    """Returns the tutorial's drawing of a lever, a DXF file."""
    return (ROOT / "tools" / "docs" / "lever.dxf").read_bytes()


def pairs() -> bytes:
    """Wrench-twist pairs as `plan-identify` reads them."""
    from planner.identification.pushes import COLUMNS

    random = Random(1)
    rows = [[random.gauss(0.0, 1.0) for _ in range(3)] for _ in range(40)]
    lines = [",".join(COLUMNS), *(",".join(f"{x:.6f}" for x in (*row, *row)) for row in rows)]
    return "\n".join(lines).encode() + b"\n"


SVG = b"""<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="100mm" viewBox="0 0 100 100">
<g transform="rotate(10 5 5) scale(1.5)"><path d="M5 5 h30 v21 a5 5 0 0 1 -5 5 L5 26 Z" fill="none"/></g>
</svg>
"""
CORNERS = ((0, 0, 0), (30, 0, 0), (0, 20, 0), (0, 0, 9))
STL = b"solid a\n%sendsolid a\n" % b"".join(
    b"facet normal 0 0 0\nouter loop\n%sendloop\nendfacet\n"
    % b"".join(b"vertex %d %d %d\n" % CORNERS[k] for k in facet)
    for facet in ((0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2))
)
OUTLINE = b"x_mm,y_mm\n0,0\n30,0\n30,21\n0,21\n"
POSES = b"x_mm,y_mm,theta_rad\n1,2,0.3\n-4,0,1.5\n"
TOUCHED = b"picture,x_mm,y_mm,theta_rad\nnone.png,1,2,3\n"
PUSHES = (
    b"14\n"
    + 14
    * b"""500 100 9.5 1 0 0 0
501 102 9.5 0.99995 0 0 0.01
4
0.0 0.1 0.1
0.1 0.1 0.1
0.2 2.0 1.0
0.3 2.1 1.1
3
0.0 450 150 9 1 0 0 0
0.2 451 150 9 1 0 0 0
0.3 452 150 9 1 0 0 0
"""
)
DELIVERY = b"""drop = [50.0, 0.0, 90.0]
width_mm = 21.0
area_mm = [-60, -60, 90, 60]
"""
FAULTS = b'[[fault]]\nkind = "reply_lost"\npart = 0\nat = 2\nlength = 1\nvalue = 0.5\n'


@cache
def gauged() -> bytes:
    """A gripper's calibration as `grasp-calibrate width` writes it."""
    with tempfile.TemporaryDirectory() as name:
        return linear(Path(name) / "g.json").read_bytes()


def case(seed: int, number: int) -> Case:
    """Returns the case that a seed and a number determine."""
    random = Random(f"inputs {seed} {number}")
    every = kinds()
    kind = random.choices(every, [kind.share for kind in every])[0]
    files = {name: change(sound, random) for name, (sound, change) in kind.files.items()}
    words = tuple(re.sub(r"\{([\w.]+)\}", r"\1", word) for word in kind.words.split())
    return Case(kind.entry, words, files | kind.keep)


def judge(given: Case, as_process: bool = False) -> str:
    """Runs a case in an empty folder, and checks the rules of this module.

    Args:
        given: the case.
        as_process: whether the command runs as a process of its own, instead of as a call.

    Returns:
        The name of the command and its exit code, as a text.

    Raises:
        AssertionError: the command broke a rule of this module.
    """
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        for file, data in given.files.items():
            Path(file).write_bytes(data)
        code, _, err = (_as_process if as_process else _within)(given)
        left = {path.name for path in Path().iterdir()}
        command = err_name(given.entry)
        assert "Traceback" not in err, err
        assert code in documented(given.entry), f"exit code {code}: {err}"
        if code not in (0, ALARM):
            assert f"\n{command}" in f"\n{err}", f"exit code {code} without a word: {err!r}"
            assert err.count("\n") <= 3, err
        for file, data in given.files.items():
            assert Path(file).read_bytes() == data, f"{file} was changed"
        drafts = {file for file in left - given.files.keys() if not file.startswith("o.")}
        assert not drafts, f"left behind: {drafts}"
    return f"{command} {given.words[0] if command == 'grasp-journal' else ''}".strip() + f": {code}"


def _within(given: Case) -> Ended:
    module, function = given.entry
    return called(getattr(importlib.import_module(module), function), *given.words)


def _as_process(given: Case) -> Ended:
    module, function = given.entry
    call = f"import sys; from {module} import {function}; sys.exit({function}())"
    return ended(
        [sys.executable, "-c", call, *given.words],
        cwd=None,
        stdin=subprocess.DEVNULL,
        errors="replace",
        timeout=LONGEST_S,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


@cache
def documented(entry: tuple[str, str]) -> frozenset[int]:
    """The exit codes that a command's --help lists, without that of an internal error."""
    epilog = importlib.import_module(PARSERS.get(entry, entry[0])).parser().epilog or ""
    listed = epilog.partition("exit codes:\n")[2]
    return frozenset(map(int, re.findall(r"^ +(\d+)  ", listed, re.MULTILINE))) - {INTERNAL}


def err_name(entry: tuple[str, str]) -> str:
    """The name with which the command's errors begin."""
    return str(importlib.import_module(PARSERS.get(entry, entry[0])).parser().prog)


def run(seed: int, numbers: Iterable[int], tell=print, longest_s=LONGEST_S) -> Counter[str]:
    """Judges the cases of some numbers in a worker process, which is replaced when a case hangs.

    Args:
        seed: seed of the cases.
        numbers: numbers of the cases.
        tell: receives a line for each failure, with the options that repeat it.
        longest_s: longest time of a case [s].

    Returns:
        The number of cases that ended in each way; all failed cases count as "FAILED".
    """
    ends: Counter[str] = Counter()
    kinds()  # cached before the worker is forked, so that no worker builds them again
    worker = _Worker(seed)
    for number in numbers:
        result = worker.judge(number, longest_s)
        if result is None:
            result = f"FAILED killed itself, or no end within {longest_s:g} s"
            worker.kill()
            worker = _Worker(seed)
        ends[result.split()[0] if result.startswith("FAILED") else result] += 1
        if result.startswith("FAILED"):
            tell(f"--seed {seed} --first {number}: {result}")
    worker.kill()
    return ends


class _Worker:
    """A forked process that judges one case after the other."""

    def __init__(self, seed: int) -> None:
        context = multiprocessing.get_context("fork")
        self._here, there = context.Pipe()
        self._process = context.Process(target=_work, args=(seed, there), daemon=True)
        self._process.start()
        there.close()

    def judge(self, number: int, longest_s: float) -> str | None:
        """Judges a case; returns how it ended, None if it did not end."""
        self._here.send(number)
        if not self._here.poll(longest_s):
            return None
        try:
            return str(self._here.recv())
        except EOFError:
            return None

    def kill(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.join()


def _work(seed: int, there: Connection) -> None:
    with contextlib.suppress(EOFError):
        while True:
            number = there.recv()
            result = case(seed, number)
            try:
                record = judge(result, as_process=number % PROCESS_EVERY == 0)
            except BaseException as error:
                frames = traceback.extract_tb(error.__traceback__)[-1]
                record = f"FAILED {' '.join(result.words)}: {type(error).__name__}: {error} ({frames.name})"
            there.send(record)
