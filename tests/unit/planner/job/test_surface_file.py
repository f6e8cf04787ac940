"""Identified limit surfaces, in files and in jobs."""

from pathlib import Path

import numpy as np
import pytest
from rectangle import TEXT

from planner.errors import KeyNameError
from planner.job import model as job
from planner.job import surface_file
from planner.mechanics import quartic
from runtime.shell.errors import InputError

RHO = 10.0
A = np.array([[1.1, 0.2, -0.1], [0.2, 0.9, 0.3], [-0.1, 0.3, 1.6]])


def job_with(pressure: str, where: str = "job") -> job.Job:
    return job.parse(TEXT.replace('kind = "boundary"', f'kind = "identified"\n{pressure}'), where)


def write(path: Path, surface: dict[str, object]) -> None:
    path.write_text(surface_file.dumps(surface, {"logs": ["pairs.csv"]}), encoding="utf-8")


@pytest.fixture(scope="module")
def surfaces(tmp_path_factory):
    """One surface file of each kind."""
    folder = tmp_path_factory.mktemp("surfaces")
    write(folder / "ellipsoid.toml", {"rho_mm": RHO, "ellipsoid": A})
    squared = quartic.of_ellipsoid(A, RHO)
    turned = squared.in_coordinates(np.array([[1.0, 0.2, 0.0], [0.0, 1.0, 0.1], [0.3, 0.0, 1.0]]))
    result = quartic.from_certificate(squared.certificate + turned.certificate, RHO)
    values = {"quartic": result.coefficients, "certificate": result.certificate}
    write(folder / "quartic.toml", {"rho_mm": RHO, **values})
    return folder


@pytest.mark.parametrize("kind", ["ellipsoid", "quartic"])
def test_parse_surface_file_equals_the_inline_surface(surfaces, kind):
    taken = job_with(f'surface_file = "{kind}.toml"', str(surfaces / "job.toml"))
    values = surface_file.load(surfaces / f"{kind}.toml")
    pressure = taken.pressure
    assert pressure.kind == "identified"
    assert pressure.rho_mm == values["rho_mm"] == RHO
    for key in ("ellipsoid", "quartic", "certificate"):
        assert np.array_equal(getattr(pressure, key), values[key])
    text = taken.canonical()
    assert "surface_file" not in text
    assert job.from_canonical(text) == taken
    held = [key for key in ("ellipsoid", "quartic", "certificate") if values[key] is not None]
    written = "\n".join(f"{key} = {values[key].tolist()}" for key in held)
    assert job_with(f"rho_mm = {RHO}\n{written}") == taken


ROWS = f"ellipsoid = {A.tolist()}"
STATED = "rho_mm = 5\n"
QUARTIC = f"{STATED}quartic = {[1] * 15}"
SURFACE_MISTAKES = {
    "nothing": ("", KeyNameError, "missing key rho_mm"),
    "rho alone": (STATED, KeyNameError, "missing key surface_file"),
    "not symmetric": (
        f"{STATED}ellipsoid = [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]",
        InputError,
        "ellipsoid",
    ),
    "file and inline": (f'surface_file = "s.toml"\n{ROWS}', InputError, "both stated"),
    "no such file": ('surface_file = "s.toml"', InputError, "check surface_file"),
    "no certificate": (QUARTIC, KeyNameError, "missing key certificate"),
    "two surfaces": (f"{QUARTIC}\n{ROWS}", InputError, "keep one surface"),
    "too short": (f"{STATED}quartic = {[1] * 14}", InputError, "must have 15 entries"),
}


@pytest.mark.parametrize("name", SURFACE_MISTAKES)
def test_parse_wrong_surface_is_refused_in_one_line(name, tmp_path):
    pressure, error, problem = SURFACE_MISTAKES[name]
    with pytest.raises(error) as caught:
        job_with(pressure, str(tmp_path / "job.toml"))
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_parse_certificate_that_does_not_fit_is_refused(surfaces):
    values = surface_file.load(surfaces / "quartic.toml")
    Q, coefficients = values["certificate"], values["quartic"]
    for bad_q, bad_c in (
        (Q, coefficients * 1.001),
        (Q - 100 * np.eye(9), coefficients),
        (-Q, -coefficients),
    ):
        text = f"rho_mm = 10\nquartic = {bad_c.tolist()}\ncertificate = {bad_q.tolist()}"
        with pytest.raises(InputError, match="does not show that the quartic is convex"):
            job_with(text)


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("format = 1", "format = 2", InputError),
        ("kind =", "kid =", KeyNameError),
        ('kind = "ellipsoid"', 'kind = "quartic"', KeyNameError),
        ("rho_mm = ", "rho_mm = [", InputError),
        ("rho_mm = 10.0", "rho_mm = -1", InputError),
    ],
)
def test_parse_damaged_surface_file_is_refused_and_named(surfaces, tmp_path, old, new, error):
    text = (surfaces / "ellipsoid.toml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "spoiled.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(error, match=r"spoiled\.toml: "):
        job_with('surface_file = "spoiled.toml"', str(tmp_path / "job.toml"))
