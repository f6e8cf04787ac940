"""Comparison of a table with the job inside it, for all values that both state.

Values that the job omits are not compared. The figures of the evaluation are not in a job; `evidence` checks
them.
"""

from collections.abc import Iterator, Mapping
from math import radians
from typing import Any

from runtime.errors import TableError
from runtime.table.embedded import Section, number, numbers, parts_of, points, section
from runtime.table.geometry import gyration_mm
from runtime.table.grip import validate_grips
from runtime.table.grippers import known, same_model
from runtime.table.model import PPM, Table
from runtime.table.timing import checked

RHO_UM = 2  # allowed difference of rho, which the planner sums in another order
UM = 1e3  # um in a mm, mN in a N, um/s in a mm/s


def validate_agreement(table: Table, job: Mapping[str, Any]) -> None:
    """Checks that a table agrees with the job inside it.

    Raises:
        TableError: the job contradicts a value of the table; the message names the first one.
    """
    for name, stated, wanted in (*_header(table, job), *_parts(table, job), *_squeezes(table, job)):
        if stated != wanted:
            raise TableError(
                f"{name} is {stated}, but the embedded job says {wanted}; recompile it"
            )
    checked(table.limits, job)
    validate_grips(table, job)


# For each compared value: its name, the table's value, the job's value.
Compared = Iterator[tuple[str, object, object]]


def _header(table: Table, job: Section) -> Compared:
    gripper, limits = table.gripper, table.limits
    stated, cell = section(job, "gripper"), section(job, "cell")
    if "model" in stated:
        model = str(stated["model"])
        wanted = gripper.model if same_model(gripper.model, model) else model
        yield "gripper.model", gripper.model, wanted
        if profile := known(model):
            yield "limits.max_force_mn", limits.max_force_mn, round(UM * profile.force_n[1])
    for name in ("opening", "finger_length", "finger_width", "noise"):
        value = getattr(gripper, f"{name}_um")
        yield from _scaled(f"gripper.{name}_um", value, stated, f"{name}_mm")
    resolution_mm = number(stated, "resolution_mm")
    if resolution_mm:
        yield "gripper.steps", gripper.steps, round(gripper.opening_um / (UM * resolution_mm))
    for name in ("max_speed", "arm_speed"):
        value = getattr(limits, f"{name}_um_s")
        yield from _scaled(f"limits.{name}_um_s", value, cell, f"{name}_mm_s")
    for name in ("retreat_height", "squeeze_height"):
        yield from _scaled(f"limits.{name}_um", getattr(limits, f"{name}_um"), cell, f"{name}_mm")
    if area := points(cell, "work_area_mm"):
        corners = tuple(round(UM * value) for corner in area for value in corner)
        yield "limits.work_area_um", tuple(limits.work_area_um), corners
    yield from _goal(table, section(job, "goal"))


def _goal(table: Table, stated: Section) -> Compared:
    goal, kind = table.goal, stated.get("kind")
    if kind is not None:
        yield "goal.kind", goal.kind, kind
    yield from _scaled("goal.distance_um", goal.distance_um, stated, "distance_mm")
    yield from _scaled("goal.confidence_ppm", goal.confidence_ppm, stated, "confidence", scale=PPM)
    if kind == "modes":
        yield from _scaled("goal.modes", goal.modes, stated, "modes", scale=1)
    if kind == "tolerances":
        held = (goal.tolerance.x_um, goal.tolerance.y_um)
        shifts = tuple(round(UM * value) for value in numbers(stated, "tolerance_mm"))
        yield "goal.tolerance", held, shifts or held
    turn_deg = number(stated, "tolerance_deg")
    if turn_deg is not None and kind in ("tolerances", "orientation"):
        theta_urad = goal.tolerance.theta_urad
        yield "goal.tolerance.theta_urad", theta_urad, round(1e6 * radians(turn_deg))
    if stated and table.hypotheses:
        yield "goal.identify", goal.identify, stated.get("identify") is not False


def _parts(table: Table, job: Section) -> Compared:
    """Yields the values of the parts to compare: their number, names, shares, symmetry and rho.

    Each is a triple of a name, the table's value and the job's value.
    """
    parts = parts_of(job)
    if not parts:
        return
    yield "the number of parts", max(1, len(table.hypotheses)), len(parts)
    for index, entry in enumerate(parts):
        part, goal = section(entry, "part"), table.goal_of(index)
        where = f"hypothesis {index}: " if table.hypotheses else "goal."
        yield from _scaled(f"{where}symmetry", goal.symmetry, part, "symmetry", scale=1)
        if table.hypotheses:
            hypothesis = table.hypotheses[index]
            yield f"{where}name", hypothesis.name, part.get("name", hypothesis.name)
            yield from _scaled(f"{where}share_ppm", hypothesis.share_ppm, entry, "share", scale=PPM)
        if outline := points(part, "outline_mm"):
            rho_um = round(UM * gyration_mm(outline))
            agrees = abs(rho_um - goal.rho_um) <= RHO_UM
            yield f"{where}rho_um", goal.rho_um, goal.rho_um if agrees else rho_um


def _squeezes(table: Table, job: Section) -> Compared:
    """Yields the values of the squeezes to compare: speed and force, and whether pushes are allowed.

    Each is a triple of a name, the table's value and the job's value.
    """
    gripper, actions = section(job, "gripper"), section(job, "actions")
    for field, key in (("speed_um_s", "speed_mm_s"), ("force_mn", "force_n")):
        wanted = sorted({round(UM * value) for value in numbers(gripper, key)})
        for index, node in enumerate(table.nodes if wanted else ()):
            value = getattr(node.squeeze, field)
            choice = wanted[0] if len(wanted) == 1 else f"one of {', '.join(map(str, wanted))}"
            yield f"node {index}: {field}", value, value if value in wanted else choice
    if actions and table.pushing is not None:
        name = f"node {table.pushing} is pushed before: actions.pushes"
        yield name, "belief", actions.get("pushes") or "none"


def _scaled(name: str, value: int, stated: Section, key: str, scale: float = UM) -> Compared:
    """Yields an integer of the table, and the number of the job with which it is compared.

    They come as one triple: the name, the table's integer, and the job's number times `scale`, rounded.
    Nothing is yielded if the job lacks the number.
    """
    wanted = number(stated, key)
    if wanted is not None:
        yield name, value, round(scale * wanted)
