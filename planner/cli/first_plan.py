"""A rough plan from a drawing, shared by first look, preview and comparison of grippers."""

from argparse import Namespace
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import NamedTuple, TypeVar

from planner.cli import course, shell
from planner.compile import Plan, compile_job
from planner.errors import FitError, NoPlanError, UnitsMissingError
from planner.job import drafts
from planner.job.drafts import FINGERS, GRIPPERS, Answers, room_mm
from planner.job.model import Job
from planner.part.importers.file import Imported, read_outline
from planner.part.importers.pieces import Options
from planner.part.tips import MARGIN_MM, tips_height_mm
from planner.work.limit import Limit
from planner.work.progress import Report

NAME = "plan-try"
REST_S, REST = 15.0, 0.3  # time kept for what follows the plan: at most, and as a share of all time
SLOW_S = 120.0  # budget of the second search, if the first one was cut short without a plan
QUICK = {"particles": 8000}  # overrides of [search]: a rough tree in the time available
TRIALS = 5000  # parts, so that shares are whole hundredths of a percent
LEAST_ROOM_MM = 4.0  # least gap between open fingers and the part at any angle, to choose a gripper
TURN_DEG = 20.0  # default turn of parts, either way, as from a chute; planning for any angle takes too long
LARGEST = 1  # number of the largest outer contour, which is the default
UNITS_ASSUMED = "one unit of the drawing is 1 mm, for it does not say (--units)"

Read = TypeVar("Read")


class Setting(NamedTuple):
    """Answers from which a job file is drafted, and the assumptions made where no answer was given."""

    answers: Answers
    assumed: list[str]  # what was assumed because it was not stated
    # What was assumed because the part is large, as clauses: "within 1 mm of ...".
    restrictions: list[str]


def progress_of(arguments: Namespace, whole: course.Whole) -> AbstractContextManager[Report]:
    """Shows progress as other commands do or, with --follow, as lines of JSON."""
    if arguments.follow:
        return nullcontext(course.objects(whole))
    return shell.progress(arguments.json, whole)


def imported_of(arguments: Namespace) -> tuple[Imported, list[str]]:
    """Reads the outline; also returns notes on the drawing and on what was assumed.

    By default the outline is the largest contour, and the unit is the mm.
    """
    options = shell.drawing_of(arguments)
    options = options._replace(contour=options.contour or LARGEST)
    imported, notes = in_mm(read_outline, arguments.drawing, options)
    height_mm = shell.thickness_of(imported.height_mm, arguments.thickness)
    return imported._replace(height_mm=height_mm), [*notes, *imported.notes]


def in_mm(
    read: Callable[[Path, Options], Read], path: Path, options: Options
) -> tuple[Read, list[str]]:
    """Reads a drawing by the function `read`; assumes mm if the drawing states no unit.

    Returns:
        The result of `read`, and a note if mm was assumed, else no notes.
    """
    try:
        return read(path, options), []
    except UnitsMissingError:
        return read(path, options._replace(units="mm")), [UNITS_ASSUMED]


def setting_of(arguments: Namespace, imported: Imported) -> Setting:
    """Collects the answers for a job from the arguments, with defaults where they state none."""
    taken, restrictions = list[str](), list[str]()
    rooms = {name: room_mm(imported, name) for name in GRIPPERS}
    gripper, usual = arguments.gripper, next(iter(GRIPPERS))
    if gripper is None:
        widest = max(rooms, key=lambda name: rooms[name])
        gripper = next((name for name, room in rooms.items() if room >= LEAST_ROOM_MM), widest)
        larger = "" if gripper == usual else f", since a {usual} does not open wide enough"
        taken.append(f"gripper {gripper}{larger} (--gripper)")
        if larger:
            restrictions.append(f"with a {gripper}")
    fingers = arguments.fingers or "rubber"
    pads = FINGERS[fingers]
    if arguments.fingers is None:
        taken.append(f"{pads.material}, friction {pads.low:g} to {pads.high:g} (--fingers)")
    turn = TURN_DEG if arguments.turn is None else arguments.turn
    if arguments.turn is None:
        more = "--turn; 180 is any angle, and takes longer"
        taken.append(f"turned by at most {turn:g} degrees ({more})")
    radius = arguments.radius
    if radius is None:
        radius = drafts.proposed_radius_mm(imported, gripper)
        room = "" if radius >= drafts.MOST_RADIUS_MM else ", for the open jaws leave no more room"
        taken.append(f"its centre within {radius:g} mm of the expected place{room} (--radius)")
        if room:
            restrictions.append(f"within {radius:g} mm of the expected place")
    taken.append(f"located means to {arguments.distance:g} mm (--distance)")
    height = imported.height_mm
    if height is None:
        taken.append(f"at least {tips_height_mm(None) + MARGIN_MM:g} mm high (--thickness)")
    name = drafts.name_of(arguments.drawing)
    answers = Answers(name, radius, turn, gripper, fingers, arguments.distance, height)
    return Setting(answers._replace(tips_mm=arguments.height_mm), taken, restrictions)


def check_thickness(imported: Imported) -> None:
    """Refuses a part that is too thin for finger tips.

    Raises:
        FitError: the part is too thin.
    """
    height_mm = imported.height_mm
    if height_mm is not None and tips_height_mm(height_mm) <= 0.0:
        must = f"finger tips must close {MARGIN_MM:g} mm below its top or lower"
        raise FitError(f"it is {height_mm:.3g} mm thin, and {must}")


def planned_within(job: Job, answer_s: float, patient: bool, report: Report) -> Plan:
    """Plans a job with few particles in a limited time.

    Args:
        job: the job.
        answer_s: time until the answer, s; the plan leaves some of it for the work that follows.
        patient: whether to search once more, for `SLOW_S`, if the time is over before there is a plan.
        report: receives the progress.

    Raises:
        NoPlanError: the time does not suffice, or no plan exists.
    """
    limit = Limit(answer_s - min(REST_S, REST * answer_s))
    try:
        return _planned(job, limit, report)
    except NoPlanError as error:
        if not (patient and error.cut_short) or limit.asked:
            raise
    return _planned(job, Limit(SLOW_S), report)


def _planned(job: Job, limit: Limit, report: Report) -> Plan:
    with shell.stopping(limit, NAME):
        return compile_job(job.replaced(search=QUICK), None, TRIALS, report, limit)
