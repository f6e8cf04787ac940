"""`grasp-calibrate camera`, `tag` and `pictures`: measurements that the audit requires."""

import argparse
import datetime
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from drivers.camera.calibration import file as calibration
from drivers.camera.calibration import residual_picture
from drivers.camera.calibration.fit import Pictures, calibrate, glue, pictures_in, read_poses
from drivers.camera.vision import tag_file
from drivers.camera.vision.board import parse
from drivers.camera.vision.sources import open_source
from drivers.camera.vision.tag_file import PartTag
from drivers.planar import Pose2
from runtime.shell.command import (
    Parser,
    add_command,
    named_path,
    natural,
    number,
    positive,
    positive_int,
    run,
    say,
    say_result,
)
from runtime.shell.errors import InputError, UsageError
from runtime.shell.exit_codes import ExitCode, epilog
from runtime.shell.files import folder, usable, write, writing

PICTURE_S = 10.0
Run = Callable[[argparse.Namespace], None]
FILE: dict[str, Any] = {"type": named_path, "metavar": "F"}
DIR: dict[str, Any] = {"type": Path, "metavar": "DIR"}
CSV: dict[str, Any] = {"type": named_path, "metavar": "CSV"}
MM: dict[str, Any] = {"type": number, "metavar": "MM"}
MOST_ID = 586  # last tag of the family 36h11
EXIT_CODES = epilog(ExitCode.INPUT, ExitCode.DEVICE, ExitCode.UNREACHABLE)
EPILOG = f"""\
example:
  grasp-calibrate pictures --camera /dev/video0 -o views      # once for each view, by Enter
  grasp-calibrate camera --name C930e-1234 --board charuco:12x9:30:22.5 --views views --table table-*.png \\
      --touched touched.csv --number 7 --references empty.png -o camera.json
  grasp-calibrate tag --calibration camera.json --part bracket --number 7 --side 22 --poses poses.csv \\
      -o tag.json

touched.csv and poses.csv: picture,x_mm,y_mm,theta_rad, a line for each pose that the arm knows.

{EXIT_CODES}"""


def parser() -> Parser:
    """Returns the parser of grasp-calibrate."""
    purpose = "Measure the parameters of camera and part for the audit."
    built = Parser(prog="grasp-calibrate", description=purpose, epilog=EPILOG)
    built.add_debug()
    names = "camera | tag | pictures"
    commands = built.add_subparsers(required=True, metavar=names, dest="command")

    def add_to(name: str, runs: Run, purpose: str, example: str) -> Callable[..., object]:
        example = f"grasp-calibrate {name} {example}"
        command = add_command(commands, purpose, example, EXIT_CODES)
        text = "print one JSON object instead of text"
        command.add_argument("--json", action="store_true", help=text)
        command.set_defaults(run=runs)
        return command.add_argument

    example = "--name S-1 --board chessboard:12x9:30 --views views --table t.png -o c.json"
    purpose = "lens and place of a camera, from pictures of a board"
    add = add_to("camera", run_camera, purpose, example)
    text = "name or serial number of the camera: the file is for this one alone"
    add("--name", required=True, help=text)
    add("--board", required=True, metavar="B", help="charuco:12x9:30:22.5 or chessboard:12x9:30")
    add("--views", required=True, **DIR, help="pictures of the board, held and tilted")
    add("--table", required=True, **FILE, nargs="+", help="pictures of the board on the table")
    add("--above", action="store_true", help="the camera looks down, and the board lies face up")
    text = "height of the board's face above the table (default: 0)"
    add("--board-height", **MM, default=0.0, help=text)
    add("--touched", **CSV, help="places of a tag that the arm knows, with pictures")
    text = "id of the tag in the pictures of --touched, not a reference tag"
    add("--number", type=_tag_id, metavar="ID", default=0, help=text)
    add("--references", **FILE, help="a picture of the tags that stay where they are")
    text = "the calibration; a picture of its residuals is written beside it"
    add("-o", "--output", required=True, **FILE, help=text)

    example = "--part bracket --number 7 --side 22 --at 0,0,0 -o tag.json"
    add = add_to("tag", run_tag, "where a tag is on its part", example)
    add("--part", required=True, help="name of the part")
    add(
        "--number",
        required=True,
        type=_tag_id,
        metavar="ID",
        help="id of the part's tag, family 36h11",
    )
    add("--side", required=True, type=positive, metavar="MM", help="edge of the tag's black border")
    text = "height of the tag's face above the table (default: 0)"
    add("--height", **MM, default=0.0, help=text)
    text = "pose of the tag on the part, if it is known: mm, mm, rad"
    add("--at", type=_pose, metavar="X,Y,THETA", help=text)
    add("--calibration", **FILE, help="of the camera that took the pictures of --poses")
    add("--poses", **CSV, help="poses of the part that the arm knows, with pictures")
    add("-o", "--output", required=True, **FILE, help="the tag file")

    purpose = "take pictures, one at each Enter"
    add = add_to("pictures", run_pictures, purpose, "--camera /dev/video0 -o views")
    add("--camera", required=True, metavar="ADDRESS", help="/dev/video0, rtsp:// or http://")
    text = "size of the pictures of a /dev/video camera (default: 1920x1080)"
    add("--size", type=_size, default=(1920, 1080), metavar="WxH", help=text)
    text = "number of pictures (default: 20)"
    add("--count", type=positive_int, default=20, metavar="N", help=text)
    text = "beginning of the pictures' names (default: view)"
    add("--stem", type=_stem, default="view", help=text)
    add("-o", "--output", required=True, **DIR, help="the folder")
    return built


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""

    def body(options: argparse.Namespace) -> int:
        cv2.setNumThreads(1)
        options.run(options)
        return 0

    return run(parser(), arguments, body)


def run_camera(options: argparse.Namespace) -> None:
    """Calibrates a camera, writes the calibration and a picture of its residuals; prints a summary."""
    board, held = parse(options.board), pictures_in(options.views)
    touched = () if options.touched is None else read_poses(options.touched)
    picture = options.output.with_suffix(".svg")
    read = [*held, *options.table, *(known.picture for known in touched)]
    read += [options.touched, options.references]
    for output, other in ((options.output, None), (picture, options.output)):
        usable(output, *read, other)
    shown = options.number, not options.above, options.board_height
    pictures = Pictures(held, options.table, touched, options.references, *shown)
    fitted = calibrate(options.name, _now(), board, pictures)
    calibration.save(fitted.calibration, options.output)
    write(picture, residual_picture.draw(fitted))
    known, off = fitted.calibration, np.hypot(*fitted.residuals.off.T)
    sigma = known.trust.sigma_mm
    numbers = [reference.number for reference in known.references]
    alignment = (
        f"alignment with the arm: {known.alignment_mm:.3f} mm rms over {len(touched)} places"
    )
    if not touched:
        alignment = (
            "no touched places were given: the board's middle and rows are the frame of all poses"
        )
    named = ", ".join(map(str, numbers))
    fields = {
        "output": str(options.output),
        "picture": str(picture),
        "camera": known.camera,
        "views": known.views,
        "left_out": fitted.left_out,
        "residual_px": known.rms_px,
        "table_rms_mm": fitted.residuals.rms_mm,
        "sigma_mm": float(np.median(sigma)),
        "alignment_mm": known.alignment_mm if touched else None,
        "references": numbers,
    }
    lines = [
        f"camera {known.camera}, {known.views} views of the board, residual {known.rms_px:.3f} px",
        *(f"left out: {name}, the board is not found in it" for name in fitted.left_out),
        f"boards on the table: {fitted.residuals.rms_mm:.3f} mm rms, {off.max():.3f} mm at most",
        f"standard deviation of a place: {np.median(sigma):.3f} mm, at worst {sigma.max():.3f} mm",
        alignment,
        f"reference tags: {named or 'none, so a moved camera will not be noticed'}",
        f"written to {options.output} and {picture}",
    ]
    say_result(options.json, fields, lines)


def run_tag(options: argparse.Namespace) -> None:
    """Writes where a tag is on its part, as stated (`--at`) or measured from pictures (`--poses`)."""
    at = options.at or (0.0, 0.0, 0.0)
    tag = PartTag(options.part, options.number, options.side, at, options.height)
    usable(options.output, options.poses, options.calibration)
    if options.at is None:
        if options.poses is None or options.calibration is None:
            raise InputError("give --at X,Y,THETA, or --calibration and --poses to measure it")
        touched = read_poses(options.poses)
        usable(options.output, *(known.picture for known in touched))
        tag = glue(calibration.load(options.calibration), tag, touched)
    tag_file.save(tag, options.output, _now())
    x_mm, y_mm, theta_rad = tag.on_part
    fields = {
        "output": str(options.output),
        "part": tag.part,
        "tag": tag.number,
        "x_mm": x_mm,
        "y_mm": y_mm,
        "theta_rad": theta_rad,
        "sigma_mm": tag.sigma_mm,
        "sigma_rad": tag.sigma_rad,
    }
    lines = (
        f"tag {tag.number} on {tag.part}: x {x_mm:.3f} mm, y {y_mm:.3f} mm, {theta_rad:.5f} rad",
        f"standard deviation: {tag.sigma_mm:.3f} mm, {tag.sigma_rad:.5f} rad",
        f"written to {options.output}",
    )
    say_result(options.json, fields, lines)


def run_pictures(options: argparse.Namespace) -> None:
    """Takes pictures, one at each press of Enter."""
    ask = _ask_beside if options.json else input
    source = open_source(options.camera, options.size)
    taken = []
    folder(options.output, Path(options.camera))
    try:
        for number in range(options.count):
            ask(f"Picture {number + 1} of {options.count}: press Enter. ")
            picture = source.picture(time.monotonic() + PICTURE_S)
            path = options.output / f"{options.stem}-{number:03d}.png"
            with writing(path) as draft:
                draft.write_bytes(cv2.imencode(".png", picture)[1].tobytes())
            taken.append(str(path))
            if not options.json:
                say(f"{path}: {picture.shape[1]} x {picture.shape[0]}")
    except EOFError:
        problem = "standard input ended before Enter was pressed; run it in a terminal"
        raise UsageError(problem) from None
    finally:
        source.close()
    say_result(options.json, {"pictures": taken}, ())


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def _ask_beside(sentence: str) -> None:
    """Prompts on standard error, since standard output is for JSON, and waits for Enter."""
    print(sentence, end="", file=sys.stderr, flush=True)
    input()


def _pose(text: str) -> Pose2:
    try:
        x_mm, y_mm, theta_rad = map(number, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: write X,Y,THETA in mm, mm, rad") from None
    return (x_mm, y_mm, theta_rad)


def _size(text: str) -> tuple[int, int]:
    try:
        width, height = map(positive_int, text.split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: write WxH in pixels") from None
    return (width, height)


def _tag_id(text: str) -> int:
    value = natural(text)
    if value > MOST_ID:
        raise argparse.ArgumentTypeError(f"{text!r} is no tag of the family 36h11, 0 to {MOST_ID}")
    return value


def _stem(text: str) -> str:
    if Path(text).name != text or not text.isprintable():
        raise argparse.ArgumentTypeError(f"{text!r} is no beginning of a file's name")
    return text


if __name__ == "__main__":
    sys.exit(main())
