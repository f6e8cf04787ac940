"""What a job file may hold: every section and key with its type, range and default, as data."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from typing import Any

from planner.errors import KeyNameError, UsageError, ValueRangeError
from planner.job.fields import (
    Either,
    Field,
    Integer,
    Number,
    Numbers,
    Text,
    check_names,
    missing_names,
    read_section,
    shown,
)

PLACE = Number(-10_000, 10_000)  # a coordinate, mm
MOST_FRICTION = 2.0
MM = 1_000.0  # no part, gripper or height of such a cell exceeds a metre


class FileName(Text):
    """A path to a file, relative to the job file."""

    longest = 1_000


TOP_LEVEL: Mapping[str, Field] = {
    "seed": Integer(0, 2**63 - 1, default=0),
}

FIELDS: Mapping[str, Mapping[str, Field]] = {
    "part": {
        "name": Text(),
        "outline_mm": Numbers(PLACE, columns=2),
        "symmetry": Either("auto", Integer(1, 10_000), default="auto"),
        "height_mm": Number(1, MM, above=True, default=None),
    },
    "pressure": {
        "kind": Text(("boundary", "uniform", "points", "identified", "stated"), default="boundary"),
        "wishart_dof": Integer(3, 1_000_000, default=100),
    },
    "friction": {
        "finger_part_min": Number(0, MOST_FRICTION),
        "finger_part_max": Number(0, MOST_FRICTION),
        "doubt": Number(0, 1, default=0.3),
    },
    "gripper": {
        "model": Text(default="robotiq-2f-85"),
        "finger_length_mm": Number(0, MM, above=True),
        "finger_width_mm": Number(0, MM, above=True),
        "opening_mm": Number(0, MM, above=True),
        "count_open": Integer(0, 255, default=3),
        "count_closed": Integer(0, 255, default=230),
        "encoder_noise_mm": Number(0, 10, default=0.15),
        "speed_mm_s": Number(0, MM, above=True, default=60.0),
        "force_n": Number(0, 10_000, above=True, default=40.0),
        "upper_finger_share": Number(0, 1, default=0.5),
    },
    "release": {
        "shift_mm": Number(0, 10, default=0.0),
        "turn_deg": Number(0, 45, default=0.0),
    },
    "uncertainty": {
        "radius_mm": Number(0, MM),
        "orientation": Text(("unknown",), default=None),
        "orientation_halfwidth_deg": Number(0, 180, default=None),
    },
    "actions": {
        "angles_deg": Numbers(Number(-360, 360), most=1_000),
        "centers_mm": Numbers(PLACE, columns=2, most=1_000),
        "proposals": Text(("belief", "none"), default="belief"),
        "openings_mm": Numbers(Number(0, MM, above=True), least=0, most=100, default=[]),
        "forces_n": Numbers(Number(0, 10_000, above=True), least=0, most=100, default=[]),
    },
    "goal": {
        "kind": Text(("pose", "tolerances", "modes", "orientation"), default="pose"),
        "distance_mm": Number(0, 100, above=True),
        "confidence": Number(0, 1, above=True, below=True),
        "tolerance_mm": Numbers(Number(0, 100, above=True), least=2, most=2, default=[2.5, 2.5]),
        "tolerance_deg": Number(0, 180, above=True, default=5.0),
        "modes": Integer(1, 8, default=1),
        "stress_trials": Integer(0, 10_000_000, default=0),
        "crash_share": Number(0, 0.05, default=0.0),
    },
    "search": {
        "method": Text(("closed-loop", "paper", "paper-sequence", "sensorless"), default="closed-loop"),
        "model": Text(("auto", "simulation", "kcde"), default="auto"),
        "rollouts": Integer(1_000, 100_000_000, default=100_000),
        "depth": Integer(1, 10, default=2),
        "squeeze_cost": Number(0, 1, default=0.01),
        "second_cost": Number(0, 1, default=0.0),
        "stability_cost": Number(0, 1, default=0.0),
        "particles": Integer(10, 10_000_000, default=20_000),
        "search_particles": Integer(10, 10_000_000, default=400),
        "max_depth": Integer(1, 100, default=12),
    },
    "cell": {
        "work_area_mm": Numbers(PLACE, columns=2, least=2, most=2, default=[[-150, -150], [150, 150]]),
        "retreat_height_mm": Number(0, MM, above=True, default=60.0),
        "squeeze_height_mm": Number(0, MM, default=None),
        "arm_speed_mm_s": Number(0, 10_000, above=True, default=250.0),
        "max_force_n": Number(0, 10_000, above=True, default=235.0),
        "max_speed_mm_s": Number(0, MM, above=True, default=150.0),
    },
    "delivery": {
        "drop_mm": Numbers(PLACE, least=2, most=2),
        "drop_angle_deg": Number(-360, 360, default=0.0),
        "grasp_mm": Numbers(PLACE, least=2, most=2, default=[0.0, 0.0]),
        "grasp_angle_deg": Number(-360, 360, default=0.0),
        "width_mm": Number(0, MM, above=True, default=None),
        "width_tolerance_mm": Number(0, MM, above=True, default=1.5),
        "area_mm": Numbers(PLACE, least=4, most=4, default=None),
    },
}

LIMIT_SURFACE: Mapping[str, Field] = {
    "ellipsoid": Numbers(Number(-1e6, 1e6), columns=3, least=3, most=3, default=None),
    "quartic": Numbers(Number(-1e9, 1e9), least=15, most=15, default=None),
    "certificate": Numbers(Number(-1e9, 1e9), columns=9, least=9, most=9, default=None),
    "rho_mm": Number(0, MM, above=True, default=None),
}
"""An identified limit surface: an ellipsoid, or a quartic with its certificate; and rho."""

_FITTED: Mapping[str, Field] = {"limit_surface": Text(("ellipsoid", "quartic"), default="ellipsoid")}

PRESSURE_FIELDS: Mapping[str, Mapping[str, Field]] = {
    "boundary": _FITTED,
    "uniform": _FITTED,
    "points": {
        **_FITTED,
        "points_mm": Numbers(PLACE, columns=2, least=2),
        "weights": Numbers(Number(0, 1e6, above=True), least=2, default=None),
    },
    "identified": {"surface_file": FileName(default=None), **LIMIT_SURFACE},
    "stated": {
        "ellipsoid": Numbers(Number(-1e6, 1e6), columns=3, least=3, most=3),
        "rho_mm": Number(0, MM, above=True),
    },
}
"""Further keys of [pressure], by its kind."""

INSTEAD = {
    "orientation": "orientation_halfwidth_deg",
    "orientation_halfwidth_deg": "orientation",
}
"""Keys that state the same thing in two ways: to set one drops the other."""

OPTIONAL_SECTIONS = ("pressure", "release", "search", "cell", "delivery")
ABSENT_SECTIONS = ("delivery",)
"""Optional sections that say nothing where they are left out: no defaults take their place."""


def read_document(document: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Check a parsed job file, key by key; conflicts between keys are the job's business.

    Args:
        document: the file as nested tables.
        where: the file, for errors.

    Returns:
        Section name to key to checked value, defaults filled in; the section "" is the top level. None for
        one of `ABSENT_SECTIONS` that is not there.

    Raises:
        KeyNameError: an unknown or missing key or section.
        ValueRangeError: a value of the wrong type or out of its range.
    """
    _check_strays(document, (*FIELDS, *TOP_LEVEL), where, "")
    check_names(document, (*FIELDS, *TOP_LEVEL), where, "")
    missing = [name for name in FIELDS if name not in document and name not in OPTIONAL_SECTIONS]
    if missing:
        raise missing_names(missing, where, "")
    top = {key: value for key, value in document.items() if key in TOP_LEVEL}
    values: dict[str, Any] = {"": read_section(top, TOP_LEVEL, where, "")}
    for name, section_fields in FIELDS.items():
        if name in ABSENT_SECTIONS and name not in document:
            values[name] = None
            continue
        table = document.get(name, {})
        if name == "pressure":
            section_fields = _pressure_fields(table, where)
        _check_strays(table, section_fields, where, name)
        values[name] = read_section(table, section_fields, where, name)
    _fill_orientation(values["uncertainty"], where)
    return values


def changed(document: Mapping[str, Any], changes: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return a document with values replaced; types and ranges are checked with the job as a whole.

    Args:
        document: sections and keys, as parsed; not modified.
        changes: values of the top level, and for each section its new values, applied in this order.
        where: what errors name as the place.

    Raises:
        UsageError: a key of the top level is taken for a section.
        KeyNameError: there is no such section, or no such key on the top level.
    """
    result = dict(document)
    for name, values in changes.items():
        if not isinstance(values, Mapping):
            check_names([name], TOP_LEVEL, where, "")
            result[name] = values
            continue
        check_names([name], (*FIELDS, *TOP_LEVEL), where, "")
        table = result.get(name, {})
        if not isinstance(table, dict):
            raise UsageError(f"{name} is no section of {where}, but one value; write it as {name}=value")
        result[name] = _with_values(table, name, values)
    return result


def _with_values(table: dict[str, Any], section: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """A section with values replaced; what the new ones exclude goes."""
    table = dict(table)
    for key, value in values.items():
        if (section, key) == ("pressure", "kind"):
            kept = {*FIELDS["pressure"], *PRESSURE_FIELDS.get(str(value), {})}
            table = {k: v for k, v in table.items() if k in kept}
        table.pop(INSTEAD.get(key, ""), None)
        table[key] = value
    return table


def _pressure_fields(table: Any, where: str) -> Mapping[str, Field]:
    """Return the keys that the stated kind of pressure takes."""
    common = FIELDS["pressure"]
    kind_only = {"kind": table["kind"]} if isinstance(table, dict) and "kind" in table else {}
    kind = read_section(kind_only, common, where, "pressure")["kind"]
    return {**common, **PRESSURE_FIELDS.get(kind, {})}


def _check_strays(table: Any, valid: Container[str], where: str, section: str) -> None:
    """Refuse a key that is valid elsewhere, and say where."""
    if not isinstance(table, dict):
        return
    homes = {key: f"belongs in [{name}]; move it there" for name, home in FIELDS.items() for key in home}
    for kind, home in PRESSURE_FIELDS.items():
        homes |= dict.fromkeys(
            home, f'goes with kind = "{kind}" in [pressure]; change the kind or drop the key'
        )
    homes |= dict.fromkeys(TOP_LEVEL, "belongs on top, before the first section; move it there")
    for key in table:
        if key in homes and key not in valid:
            error = KeyNameError(f"key {shown(key)} {homes[key]}", where=where, section=section, value=key)
            error.names = (key,)
            raise error


def _fill_orientation(uncertainty: dict[str, Any], where: str) -> None:
    """Turn the two ways to state an orientation into one: a half-width, 180 deg for "unknown"."""
    unknown = uncertainty.pop("orientation") is not None
    stated = uncertainty["orientation_halfwidth_deg"] is not None
    choice = 'orientation = "unknown" or orientation_halfwidth_deg'
    if not unknown and not stated:
        error = KeyNameError(f"missing key orientation; state {choice}", where=where, section="uncertainty")
        error.names = ("orientation",)
        raise error
    if unknown and stated:
        raise ValueRangeError(
            f"state {choice}, not both", where=where, section="uncertainty", key="orientation"
        )
    if unknown:
        uncertainty["orientation_halfwidth_deg"] = math.degrees(math.pi)
