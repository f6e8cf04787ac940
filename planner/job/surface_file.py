"""Files of limit surfaces: `plan-identify` writes them, and a job names one in place of a pressure.

    format = 1
    kind = "ellipsoid"          # or "quartic"
    rho_mm = 75.0
    ellipsoid = [[...], ...]    # or quartic = [15 numbers] and certificate = [9 rows of 9]

    [identification]            # how it was identified, for people; not read back

A job of `kind = "identified"` names the file by `surface_file`, or contains the same keys, as the canonical
form of a job always does.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.errors import KeyNameError
from planner.job import documents
from planner.job.fields import Field, Integer, Text, read_section
from planner.job.schema import LIMIT_SURFACE
from planner.part import quartic_form
from runtime.shell.errors import InputError

FORMAT = 1
IDENTIFICATION = "identification"
HEADER = """\
# A limit surface, written by plan-identify. Name it in a job file:
#     [pressure]
#     kind = "identified"
#     surface_file = "this file"
"""

_FIELDS: Mapping[str, Field] = {
    "format": Integer(FORMAT, FORMAT),
    "kind": Text(("ellipsoid", "quartic")),
    **LIMIT_SURFACE,
}


def dumps(values: Mapping[str, Any], identification: Mapping[str, Any]) -> str:
    """Returns the text of a surface file; numbers are exact.

    Args:
        values: the value of each key of `schema.LIMIT_SURFACE`.
        identification: texts, numbers and lists of texts about the origin of the surface.
    """
    import tomlkit  # only writing a surface needs it, not reading a job

    kind = "quartic" if "quartic" in values else "ellipsoid"
    plain = {key: np.asarray(value).tolist() for key, value in values.items()}
    head = {"format": FORMAT, "kind": kind, **plain}
    return HEADER + tomlkit.dumps({**head, IDENTIFICATION: identification})


def load(path: Path) -> dict[str, Any]:
    """Reads a surface file.

    Returns:
        The checked values by the keys of `schema.LIMIT_SURFACE`; None where a key is absent.

    Raises:
        InputError: the file is missing or unreadable, a key is missing or unknown, a value is out of range,
            or the surface is not shown to be convex.
    """
    document = documents.from_toml(documents.read(path, "check surface_file"), str(path))
    document.pop(IDENTIFICATION, None)
    try:
        values = read_section(document, _FIELDS, "")
        kind = values.pop("kind")
        del values["format"]
        check(values, "")
        if values[kind] is None:
            raise KeyNameError(f"missing key {kind}, as kind says; write the file again")
    except InputError as error:
        raise error.at(str(path)) from None
    return values


def resolve(pressure: dict[str, Any], folder: Path | None) -> None:
    """Replaces the key `surface_file` of an identified pressure by the content of the file that it names.

    If the key is missing, checks the limit surface that `pressure` itself states. Changes `pressure` in
    place, and only if its kind is "identified". The path of the file is relative to `folder`, the folder of
    the job file. `folder` is None for the canonical form of a job, which may not name files.

    Raises:
        InputError: the file cannot be used; or the surface is stated twice, or not at all, or is not shown
            to be convex.
    """
    if pressure["kind"] != "identified":
        return
    name = pressure.pop("surface_file")
    inline = [key for key in LIMIT_SURFACE if pressure[key] is not None]
    if name is None:
        check(pressure, "pressure")
    elif inline or folder is None:
        problem = "must be resolved; compile again"
        if inline:
            problem = f"and {inline[0]} are both stated; keep one"
        raise InputError(problem, section="pressure", key="surface_file")
    else:
        pressure.update(load(folder / name))


def check(values: Mapping[str, Any], section: str) -> None:
    """Checks that values state exactly one limit surface, which is shown to be convex.

    Raises:
        KeyNameError: rho, the surface or the certificate of a quartic is missing.
        InputError: there are both an ellipsoid and a quartic, the ellipsoid is not symmetric positive
            definite, or the certificate does not show that the quartic is convex.
    """
    ellipsoid, coefficients = values["ellipsoid"], values["quartic"]
    certificate = values["certificate"]
    if values["rho_mm"] is None:
        raise _missing("rho_mm", "the length that torques are divided by", section)
    if ellipsoid is None and coefficients is None:
        raise _missing("surface_file", "or ellipsoid, or quartic and certificate", section)
    if ellipsoid is not None and (coefficients is not None or certificate is not None):
        problem = "goes without quartic and certificate; keep one surface"
        raise InputError(problem, section=section, key="ellipsoid")
    if ellipsoid is not None:
        check_ellipsoid(ellipsoid, section)
        return
    if coefficients is None or certificate is None:
        absent = "certificate" if certificate is None else "quartic"
        raise _missing(absent, "a quartic comes with its certificate", section)
    if not quartic_form.certifies(certificate, coefficients):
        problem = "does not show that the quartic is convex"
        problem += "; take both from one file of plan-identify"
        raise InputError(problem, section=section, key="certificate")


def check_ellipsoid(A: Array, section: str) -> None:
    """Raises `InputError` for a matrix A (3, 3) that is not symmetric positive definite."""
    if not (A == A.T).all() or np.linalg.eigvalsh(A)[0] <= 0.0:
        problem = "must be a symmetric positive definite 3 x 3 matrix"
        raise InputError(problem, section=section, key="ellipsoid")


def _missing(key: str, meaning: str, section: str) -> KeyNameError:
    return KeyNameError(f"missing key {key}; state it ({meaning})", section=section)
