"""`grasp-audit judge`: judge parts by a camera; `report` is only told of here, for it needs none."""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2

from drivers.camera import calibration, drift, service, subject, tag_file
from drivers.camera.auditor import Auditor
from drivers.camera.sources import open_source
from runtime.shell.files import folder

EXIT_CODES = """\
exit codes:
  0  done (the questions ended)     2  usage            3  file missing   23  no camera
  13 a chart of the report alarms  24  a journal does not verify
  30 table refused                 33  calibration or tag file refused
  130 interrupted (Ctrl-C)
"""
EPILOG = (
    """\
examples:
  grasp-runtime --tree T.msgpack --port ... \\
      --audit "grasp-audit judge --tree T.msgpack --camera /dev/video0 --calibration cam.json --tag tag.json"
  grasp-audit report runs/*.jsonl -o report.html

judge reads questions from its standard input, one JSON object a line, and answers each by one line:
  {"part": 3, "x_mm": 0.0, "y_mm": 0.5, "theta_rad": 0.0} -> {"verdict": "pass", "reason": "...", ...}

"""
    + EXIT_CODES
)


def parser() -> argparse.ArgumentParser:
    """The command line of `grasp-audit judge`; `report` has its own."""
    built = argparse.ArgumentParser(
        prog="grasp-audit",
        description="Was the answer right, in millimetres?",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = built.add_subparsers(required=True, metavar="judge | report", dest="command")
    told = "answer questions about parts, one a line"
    example = "grasp-audit judge --tree T.msgpack --camera /dev/video0 --calibration cam.json --tag tag.json"
    add = commands.add_parser(
        "judge", help=told, description=f"{told[0].upper()}{told[1:]}: JSON in, JSON out.",
        epilog=f"example:\n  {example}\n\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    ).add_argument  # fmt: skip
    add("--tree", type=Path, required=True, metavar="T.msgpack", help="the table: its goal and its part")
    add("--camera", required=True, metavar="ADDRESS", help="/dev/video0, rtsp://, http:// or a folder")
    add("--calibration", type=Path, required=True, metavar="F", help="from grasp-calibrate camera")
    add("--tag", type=Path, required=True, metavar="F", help="from grasp-calibrate tag")
    add("--pictures", type=Path, metavar="DIR", help="keep an overlay of every part that does not pass")
    add(
        "--moved-mm",
        type=_positive,
        default=drift.LIMIT_MM,
        help="limit of reference tags (default: %(default)s)",
    )
    add("--deadline", type=_positive, default=5.0, metavar="S", help="for an answer (default: %(default)s)")
    add("--memory-mb", type=_positive, default=400.0, metavar="MB", help="to grow by (default: %(default)s)")
    add("--debug", action="store_true", help="print the traceback of an error")
    commands.add_parser("report", help="success, residuals and control charts from journals", add_help=False)
    return built


def main(arguments: Sequence[str] | None = None) -> int:
    """Run grasp-audit; returns its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = parser().parse_args(words)
    try:
        if judge(options):
            os.execv(sys.executable, [sys.executable, "-m", "drivers.camera.cli", *words])
    except KeyboardInterrupt:
        return 130
    except Exception as error:
        if options.debug:
            raise
        print(f"grasp-audit: {' '.join(str(error).split())}", file=sys.stderr)
        return int(getattr(error, "exit_code", 1))
    # A thread that hangs in a camera's driver would keep an ordinary exit waiting.
    sys.stderr.flush()
    os._exit(0)


def judge(options: argparse.Namespace) -> bool:
    """Answer questions; returns whether to start anew.

    Nothing that can be wrong with the files keeps the cell from running: it is told once, and every
    verdict is then "unknown" for that reason.
    """
    cv2.setNumThreads(1)
    full = service.limit_memory(options.memory_mb)
    worker = service.Worker(lambda: make(options))
    return service.serve(
        service.Lines(sys.stdin.fileno()),
        worker,
        lambda line: os.write(sys.stdout.fileno(), line),
        options.deadline,
        full,
    )


def make(options: argparse.Namespace) -> Auditor:
    """The auditor of a command line.

    Raises:
        CameraError: a file about the camera is refused, or there is none.
        Exception: the table's reader's own errors.
    """
    if options.pictures is not None:
        folder(options.pictures, Path(options.camera))
    known = calibration.load(options.calibration)
    about = subject.from_table(options.tree, tag_file.load(options.tag))
    lens = known.view.lens
    source = open_source(options.camera, (lens.width, lens.height))
    return Auditor(source, known, about, options.moved_mm, options.pictures)


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


if __name__ == "__main__":
    sys.exit(main())
