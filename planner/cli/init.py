"""plan-init: a job file from a drawing and a few answers."""

import argparse
import sys
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TypeVar

from planner.cli import shell
from planner.errors import UnitsMissingError
from planner.job.drafts import (
    FINGERS,
    GRIPPERS,
    Answers,
    draft,
    name_of,
    proposed_radius_mm,
    room_mm,
)
from planner.part.importers.file import SUFFIXES, Face, Imported, read_faces, read_outline
from planner.part.importers.pieces import UNITS_MM, Options
from planner.part.outline import reach, smallest_rectangle
from planner.part.tips import tips_height_mm
from runtime.shell.command import Parser, number, say
from runtime.shell.errors import UsageError
from runtime.shell.files import fitting, quoted, usable, write

NAME = "plan-init"
T = TypeVar("T")


def parser() -> Parser:
    """The parser of the command line."""
    built = shell.parser(
        NAME,
        "Begin a job: the outline from a drawing, the rest from answers. What is not stated is asked for on\n"
        "a terminal. The file that comes out explains every field.",
        f"{NAME} bracket.dxf -o job.toml --radius 10 --gripper robotiq-2f-85 --fingers rubber",
        f"{NAME} bracket.svg -o job.toml",
        f"{NAME} bracket.stl --units mm --faces -o job.toml",
    )
    built.add_argument("outline", type=Path, help=f"the drawing: {', '.join(SUFFIXES)}")
    shell.add_output(built, "JOB.toml", "the job file")
    built.add_argument("--force", action="store_true", help="overwrite the job file if it exists")
    shell.add_drawing(built.add_argument_group("the drawing"))
    text = "for an STL solid that may lie on any of its stable faces: each face becomes one of several parts"
    built.add_argument("--faces", action="store_true", help=text)
    answers = built.add_argument_group("the answers")
    add = answers.add_argument
    add("--name", help="name of the part")
    add("--radius", type=number, metavar="MM", help="its centre lies in a disc of this radius")
    text = "the part is turned by at most this, either way (default: any angle)"
    add("--turn", type=number, metavar="DEG", help=text)
    text = "height of the part, from the table to its top (default, and at least: that of an STL solid)"
    add("--thickness", type=number, metavar="MM", help=text)
    add("--gripper", choices=GRIPPERS, help="model of the gripper")
    add("--fingers", choices=FINGERS, help="material of the finger pads")
    shell.add_distance(answers)
    return built


def _init(arguments: argparse.Namespace) -> None:
    output = fitting(usable(arguments.output, arguments.outline), "a job file", ".toml")
    if output.exists() and not arguments.force:
        remedy = "name another file, or overwrite it with --force"
        raise UsageError(f"{output} is there already; {remedy}")
    asking = sys.stdin.isatty() and not arguments.json
    faces = _faces(arguments) if arguments.faces else []
    if faces:  # one set of answers for all faces
        imported = max((face.imported for face in faces), key=lambda each: reach(each.outline_mm))
    else:
        imported = _imported(arguments.outline, _drawing(arguments), asking)
    several = faces if len(faces) > 1 else []
    if not arguments.json:
        _show_faces(faces) if several else _show(imported)
    answers = _answers(arguments, imported, asking)
    text = draft(imported, arguments.outline.name, answers, several)
    write(output, text)
    figures = {
        "output": str(output),
        "vertices": len(imported.outline_mm),
        "symmetry": imported.symmetry,
        "size_mm": imported.size_mm.tolist(),
        "height_mm": answers.height_mm,
        "notes": imported.notes,
        **({"faces": [_figures_of(face) for face in faces]} if arguments.faces else {}),
    }
    table = output.with_suffix(".msgpack")
    lines = [f"wrote {output}; next: plan-compile {quoted(output)} -o {quoted(table)}"]
    if answers.height_mm is None:
        advice = "state --thickness, or height_mm in the file"
        lines.insert(0, f"note: the part's thickness is not stated; {advice}")
    shell.answer(arguments.json, figures, *lines)


def _drawing(arguments: argparse.Namespace) -> Options:
    """Options for reading the drawing; without --height, the tips' height follows from --thickness."""
    options = shell.drawing_of(arguments)
    if options.height_mm is None and arguments.thickness is not None:
        tips_mm = tips_height_mm(arguments.thickness)
        options = options._replace(height_mm=tips_mm if tips_mm > 0.0 else None)
    return options


def _faces(arguments: argparse.Namespace) -> list[Face]:
    for name in ("contour", "thickness"):
        if getattr(arguments, name) is not None:
            raise UsageError(f"--faces measures the solid itself; leave out --{name}")
    return read_faces(arguments.outline, shell.drawing_of(arguments), tips_height_mm)


def _figures_of(face: Face) -> dict[str, object]:
    return {
        "share": round(face.share, 6),
        "down": face.down,
        "size_mm": face.imported.size_mm.tolist(),
        "height_mm": face.imported.height_mm,
        "cut_mm": face.cut_mm,
        "notes": face.imported.notes,
    }


def _show_faces(faces: list[Face]) -> None:
    for place, face in enumerate(faces, start=1):
        width, height = face.imported.size_mm
        size = f"{width:.3f} x {height:.3f} mm, {face.imported.height_mm:.4g} mm high"
        lies = f"{face.share:.1%} of the parts, {face.down_text} of the solid down"
        print(f"face {place}: {lies}; {size}")
        for note in face.imported.notes:
            say(f"note: {note}")
    dropped = "the shares are those of the directions in which the part may be dropped"
    print(f"note: {dropped}; bouncing and rolling on are ignored, so count some parts")


def _imported(path: Path, options: Options, asking: bool) -> Imported:
    """Reads the outline; on a terminal, asks for a missing unit."""
    try:
        return read_outline(path, options)
    except UnitsMissingError as error:
        if not asking:
            raise
        say(str(error))
        return read_outline(path, options._replace(units=_choice("one unit is", UNITS_MM)))


def _show(imported: Imported) -> None:
    width, height = imported.size_mm
    order = imported.symmetry
    turn = f"order {order}: a turn by {360 / order:.4g} degrees looks the same"
    message = turn if order > 1 else "none"
    extent = f"{len(imported.outline_mm)} vertices, {width:.3f} x {height:.3f} mm"
    print(f"outline: {extent}; symmetry: {message}")
    print(f"smallest rectangle about it: {smallest_rectangle(imported.outline_mm).text()}")
    for note in imported.notes:
        say(f"note: {note}")


def _answers(arguments: argparse.Namespace, imported: Imported, asking: bool) -> Answers:
    needed = ("radius", "gripper", "fingers")
    missing = [f"--{name}" for name in needed if getattr(arguments, name) is None]
    if missing and not asking:
        flags = ", ".join(missing)
        raise UsageError(f"{flags} must be stated where there is no terminal to ask at")
    name = arguments.name
    if name is None:
        stem = name_of(arguments.outline)
        name = _ask(f"name of the part [{stem}]: ", lambda text: text or stem) if asking else stem
    gripper = arguments.gripper or _choice("gripper", GRIPPERS)
    fingers = arguments.fingers or _choice("fingers", FINGERS)
    room = room_mm(imported, gripper)
    radius = arguments.radius
    if radius is None:
        proposed = proposed_radius_mm(imported, gripper)
        question = f"its centre lies in a disc of radius [{proposed:g} mm]: "
        radius = _ask(question, lambda text: number(text) if text else proposed)
    if radius > room and arguments.turn is None:
        clear = f"clear the part at any angle only within {room:.1f} mm of the hand"
        if room <= 0.0:
            clear = "do not clear the part at every angle, wherever it lies"
        remedy = "a smaller --radius, a --turn or a wider gripper may be needed"
        print(f"{NAME}: warning: open fingers {clear}; {remedy}", file=sys.stderr)
    thickness = shell.thickness_of(imported.height_mm, arguments.thickness)
    if thickness is None and asking:
        question = "its thickness, table to top [mm; empty: not known]: "
        thickness = _ask(question, lambda text: number(text) if text else None)
    answers = Answers(name, radius, arguments.turn, gripper, fingers, arguments.distance, thickness)
    solid = imported.height_mm is not None
    return answers._replace(tips_mm=_drawing(arguments).height_mm if solid else arguments.height_mm)


def _choice(question: str, choices: Collection[str]) -> str:
    names = ", ".join(choices)

    def parse(text: str) -> str:
        if text not in choices:
            raise ValueError(f"one of {names}")
        return text

    return _ask(f"{question} ({names}): ", parse)


def _ask(question: str, parse: Callable[[str], T]) -> T:
    """Asks until `parse` accepts an answer; returns its result.

    Raises:
        UsageError: the input ended.
    """
    while True:
        try:
            return parse(input(question).strip())
        except EOFError:
            problem = "the input ended before all was answered; state the rest as flags"
            raise UsageError(problem) from None
        except (ValueError, argparse.ArgumentTypeError) as error:
            print(f"  {error}")


main = shell.main_of(parser, _init)
