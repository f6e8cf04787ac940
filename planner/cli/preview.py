"""Preview of `squeezetree try`: contours, outline, jaws and defaults of a drawing before planning.

Run as a program, this module reads a JSON list of arguments from each line of its input, and prints one JSON
object for each line. The studio runs the program as a separate process: a drawing that takes all memory or
time ends only this process, and the page stays.
"""

import contextlib
import json
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
import shapely

from planner.arrays import Array
from planner.cli import first_look, first_plan, shell
from planner.job.drafts import FINGERS, GRIPPERS, draft, opening_of, room_mm
from planner.part.importers.contours import LISTED, Contour
from planner.part.importers.file import Imported, read_contours
from planner.part.outline import reach, smallest_rectangle
from planner.report.canvas import points
from runtime.shell.command import sentence_of
from runtime.shell.errors import ExpectedError, UsageError

FINENESS = 1e-3  # tolerance of the contours on the page, as a share of their larger extent


def preview(words: Sequence[str]) -> dict[str, Any]:
    """Returns contours, outline, jaws and defaults for arguments of `squeezetree try`, as JSON types.

    The key `error` says why the arguments are refused; None if they are not.
    """
    shown: dict[str, Any] = {"contours": [], "error": None}
    try:
        arguments = _parsed(words)
        options = shell.drawing_of(arguments)
        listed, _ = first_plan.in_mm(read_contours, arguments.drawing, options)
        numbered = enumerate(listed[:LISTED], 1)
        shown["contours"] = [_contour(number, contour) for number, contour in numbered]
        shown["contour"] = options.contour or first_plan.LARGEST
        imported, notes = first_plan.imported_of(arguments)
        setting = first_plan.setting_of(arguments, imported)
        shown |= {**_part(imported), "assumed": [*notes, *setting.assumed]}
        length_mm, width_mm = GRIPPERS[setting.answers.gripper].fingers_mm
        opening_mm = opening_of(setting.answers.gripper)
        shown["hand"] = {"opening_mm": opening_mm, "length_mm": length_mm, "width_mm": width_mm}
        shown["rooms_mm"] = {name: round(room_mm(imported, name), 1) for name in GRIPPERS}
        pads = FINGERS[setting.answers.fingers]
        shown["friction"] = {"low": pads.low, "high": pads.high}
        shown |= setting.answers._asdict()
        first_plan.check_thickness(imported)
        draft(imported, arguments.drawing.name, setting.answers)
    except (ExpectedError, OSError) as error:
        shown["error"] = sentence_of(error)
    return shown


def main() -> int:
    """Prints the preview for each line of standard input; each line is a JSON list of arguments."""
    out, sys.stdout = sys.stdout, sys.stderr  # libraries may print
    with contextlib.suppress(BrokenPipeError):  # the client was killed meanwhile
        for line in sys.stdin:
            out.write(json.dumps(preview(json.loads(line))) + "\n")
            out.flush()
    return 0


def _parsed(words: Sequence[str]) -> Any:
    parser = first_look.parser()

    def refuse(message: str) -> NoReturn:
        raise UsageError(message)

    parser.error = refuse  # type: ignore[method-assign]
    return parser.parse_args(words)


def _contour(number: int, contour: Contour) -> dict[str, Any]:
    width, height = np.ptp(contour.points, axis=0)
    low = contour.points.min(axis=0)
    ring = shapely.linearrings(contour.points - low)
    line = shapely.simplify(ring, FINENESS * max(width, height))
    return {
        "number": number,
        "width_mm": round(float(width), 2),
        "height_mm": round(float(height), 2),
        "outer": contour.outer,
        "points": points(shapely.get_coordinates(line)),
    }


def _part(imported: Imported) -> dict[str, Any]:
    x, y = imported.origin_mm
    return {
        "outline": points(imported.outline_mm),
        "holes": [points(hole) for hole in imported.holes_mm],
        "size": smallest_rectangle(imported.outline_mm).text(),
        "vertices": len(imported.outline_mm),
        "reach_mm": _rounded(reach(imported.outline_mm)),
        "symmetry": imported.symmetry,
        "datum": {"x_mm": _rounded(x), "y_mm": _rounded(y), "name": imported.origin_name},
    }


def _rounded(mm: float | Array) -> float:
    return round(float(mm), 2)


if __name__ == "__main__":
    sys.exit(main())
