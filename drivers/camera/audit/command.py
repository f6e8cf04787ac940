"""`grasp-audit judge`, which judges parts by a camera; `report` and `study` are in `runtime.spc`."""

import argparse
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import cv2

from drivers.camera.audit import service, subject
from drivers.camera.audit.auditor import Auditor
from drivers.camera.calibration import drift
from drivers.camera.calibration import file as calibration
from drivers.camera.vision import tag_file
from drivers.camera.vision.sources import Folder, Source, open_source
from runtime.shell.command import Parser, add_command, positive, run
from runtime.shell.exit_codes import ExitCode, epilog
from runtime.shell.files import folder
from runtime.table import TableError, load

ENDS = (ExitCode.INPUT, ExitCode.CHECK_FAILED, ExitCode.UNDECIDED, ExitCode.UNREACHABLE)
EXIT_CODES = epilog(*ENDS, ExitCode.JOURNAL)
EPILOG = (
    """\
examples:
  grasp-runtime --tree T.msgpack --port ... \\
      --audit "grasp-audit judge --tree T.msgpack --camera /dev/video0 --calibration cam.json --tag tag.json"
  grasp-audit report runs/*.jsonl -o report.html
  grasp-audit study run-off.jsonl -o run-off.html

judge reads questions from its standard input, one JSON object a line, and answers each by one line:
  {"part": 3, "x_mm": 0.0, "y_mm": 0.5, "theta_rad": 0.0} -> {"verdict": "pass", "reason": "...", ...}
A question may name the run's table by "table_sha256"; with another --tree its verdict is "unknown".

"""
    + EXIT_CODES
)


def parser() -> Parser:
    """Returns the parser of `judge`; its help lists `report` and `study` too, which have separate parsers."""
    purpose = "Was the answer right, in millimetres?"
    built = Parser(prog="grasp-audit", description=purpose, epilog=EPILOG)
    commands = built.add_subparsers(required=True, metavar="judge | report | study", dest="command")
    purpose = "answer questions about parts, one a line: JSON in, JSON out"
    example = "grasp-audit judge --tree T.msgpack --camera /dev/video0 --calibration cam.json --tag tag.json"
    command = add_command(commands, purpose, example, EXIT_CODES)
    add = command.add_argument
    goal, cameras = "the table: its goal and its part", "/dev/video0, rtsp://, http:// or a folder"
    add("--tree", type=Path, required=True, metavar="T.msgpack", help=goal)
    add("--camera", required=True, metavar="ADDRESS", help=cameras)
    add("--calibration", type=Path, required=True, metavar="F", help="from grasp-calibrate camera")
    tags = "from grasp-calibrate tag; for a table of several parts once for each, whose name is its --part"
    add("--tag", type=Path, required=True, action="append", metavar="F", help=tags)
    kept = "keep an overlay of every part that does not pass"
    add("--pictures", type=Path, metavar="DIR", help=kept)
    limit = "motion of a reference tag above which no part is judged (default: %(default)s)"
    add("--moved-mm", type=positive, default=drift.LIMIT_MM, help=limit)
    answer = "time limit for an answer (default: %(default)s)"
    growth = "memory that the process may gain before it restarts (default: %(default)s)"
    add("--deadline", type=positive, default=5.0, metavar="S", help=answer)
    add("--memory-mb", type=positive, default=400.0, metavar="MB", help=growth)
    # Only for the restart in `judge`: the last picture that was taken from a folder.
    add("--after", default="", help=argparse.SUPPRESS)
    command.add_debug()
    reports = "success, residuals and control charts from journals"
    commands.add_parser("report", help=reports, add_help=False)
    studies = "acceptance of a cell, gauge studies, run-off sheet"
    commands.add_parser("study", help=studies, add_help=False)
    return built


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `grasp-audit judge`, and ends the process with its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    code = run(parser(), words, lambda options: judge(options, words))
    # A thread that hangs in a camera's driver would delay an ordinary exit.
    sys.stderr.flush()
    os._exit(code)


def judge(options: argparse.Namespace, words: Sequence[str]) -> int:
    """Answers the cell's questions on standard input; restarts the process when its memory is too large.

    A faulty file or camera does not stop the cell: every verdict is then "unknown", with the reason, and
    the error is raised only after the last question.
    """
    cv2.setNumThreads(1)
    full = service.limit_memory(options.memory_mb)
    sources = list[Source]()
    worker = service.Worker(lambda: make(options, sources), options.deadline)
    lines = service.Lines(sys.stdin.fileno())
    judged_by = digest_of(options.tree)
    if service.serve(lines, worker, partial(os.write, 1), full, judged_by):
        again = [sys.executable, "-P", "-m", "drivers.camera.audit.command", *words]
        for source in sources:  # no picture is judged twice
            again += [f"--after={source.last}"] if isinstance(source, Folder) else []
        os.execv(sys.executable, again)
    if worker.why_not is not None:
        raise worker.why_not
    if not worker.asked:
        read(options)  # reports faulty files also if there was no question
    return 0


def read(
    options: argparse.Namespace,
) -> tuple[calibration.CameraCalibration, tuple[subject.Subject, ...]]:
    """Reads the calibration and the parts that a command line names; raises the errors of their readers."""
    tags = [tag_file.load(path) for path in options.tag]
    return calibration.load(options.calibration), subject.from_table(options.tree, tags)


def digest_of(tree: Path) -> str | None:
    """Returns the SHA-256 of a table's file; None if the file is invalid, which `read` reports."""
    try:
        return load(tree).digest
    except TableError:
        return None


def make(options: argparse.Namespace, sources: list[Source]) -> Auditor:
    """Creates the auditor that a command line describes, and adds its source of pictures to `sources`.

    Raises the errors of `read` and `open_source`.
    """
    if options.pictures is not None:
        folder(options.pictures, Path(options.camera))
    known, about = read(options)
    lens = known.view.lens
    source = open_source(options.camera, (lens.width, lens.height), options.after)
    sources.append(source)
    return Auditor(source, known, about, options.moved_mm, options.pictures)


if __name__ == "__main__":
    sys.exit(main())
