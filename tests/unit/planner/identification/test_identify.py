"""Identification of a limit surface from pairs of wrench and twist, and the command that does it."""

from pathlib import Path

import numpy as np
import pytest
from problems import rectangle
from programs import called, document

from planner.cli.identify import main
from planner.identification import identify, pushes
from planner.job import surface_file
from planner.mechanics import limit_surface
from planner.part.pressure import Pressure, support

pytestmark = pytest.mark.slow

RHO = 10.0
A = np.array([[1.1, 0.2, -0.1], [0.2, 0.9, 0.3], [-0.1, 0.3, 1.6]])


def ellipsoid_pairs(count: int, noise: float, seed: int = 0, friction: float = 4.0) -> pushes.Pairs:
    """Random wrenches [N, N mm] on a limit surface, and their twists with noise.

    The surface is the ellipsoid of the matrix `A`, enlarged by the factor `friction`.
    """
    rng = np.random.default_rng(seed)
    F = rng.normal(size=(count, 3))
    F /= np.sqrt(np.einsum("ki,ij,kj->k", F, A, F))[:, None]
    V = limit_surface.twist(A, F) + rng.normal(scale=noise, size=(count, 3))
    return pushes.Pairs(friction * F * [1, 1, RHO], 3.0 * V / [1, 1, RHO], np.ones(count))


def rectangle_pairs(count: int, noise: float, seed: int = 0) -> pushes.Pairs:
    rng = np.random.default_rng(seed)
    V = rng.normal(size=(count, 3))
    V /= np.linalg.norm(V, axis=1, keepdims=True)
    F = limit_surface.wrenches(*support(Pressure("boundary", 100), rectangle()), RHO, V)
    V += rng.normal(scale=noise, size=V.shape)
    return pushes.Pairs(F * [1, 1, RHO], V / [1, 1, RHO], np.ones(count))


def identified(
    pairs: pushes.Pairs, *kinds: identify.Kind, splits: int = 3, seed: int = 0, share: float = 0.5
):
    data = identify.normalise(pairs, RHO)
    return identify.identify(data, RHO, kinds, splits=splits, train_share=share, seed=seed)


def write_csv(path: Path, pairs: pushes.Pairs) -> Path:
    rows = np.column_stack([pairs.wrenches, pairs.twists]).tolist()
    lines = [",".join(pushes.COLUMNS), *(",".join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_identify_exact_ellipsoid_is_recovered_by_both_kinds():
    ellipsoid, squared = identified(ellipsoid_pairs(40, 0.0), "ellipsoid", "quartic", splits=1)
    assert ellipsoid.errors_rad.max() < 1e-6
    assert squared.errors_rad.max() < 0.01
    fitted = ellipsoid.fit.surface.A * (4.0 / ellipsoid.fit.friction_n) ** 2
    assert np.allclose(fitted, A, rtol=1e-6)


def test_choose_ridge_noisy_pairs_is_the_strongest():
    noisy = identify.normalise(ellipsoid_pairs(25, 0.3, friction=1.0), RHO)
    assert identify.choose_ridge(noisy, RHO, np.random.default_rng(0)) == max(identify.RIDGES)


def test_identify_held_out_errors_are_of_unseen_pairs():
    """One pair contradicts all others. Whenever it is held out, the others predict it badly."""
    pairs = ellipsoid_pairs(20, 0.0)
    pairs.twists[0] = -pairs.twists[0]
    (result,) = identified(pairs, "ellipsoid", splits=8, share=0.7)
    data = identify.normalise(pairs, RHO)
    held_out = np.isfinite(result.held_out[:, 0])
    error = identify.angles(result.held_out[held_out], data.V[held_out])
    assert error[0] > 3.0
    assert error[1:].max() < 1e-6
    once = identified(pairs, "ellipsoid", splits=1, share=0.7)[0]
    assert np.isfinite(once.held_out[:, 0]).sum() == 6


def test_identify_command_writes_the_surfaces_and_the_best_of_them(tmp_path):
    log = write_csv(tmp_path / "pairs.csv", rectangle_pairs(24, 0.05))
    output, picture = tmp_path / "surface.toml", tmp_path / "surface.png"
    options = ["-o", output, "--figure", picture, "--rho-mm", "10", "--splits", "1"]
    report = document(main, log, *options, "--json")
    errors = {entry["kind"]: entry["held_out_error_deg"] for entry in report["surfaces"]}
    assert report["best"] == min(errors, key=errors.get)
    assert surface_file.load(output)[report["best"]] is not None
    assert report["written"] == [str(output), str(picture)]
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_identify_command_refuses_bad_input_in_one_line(tmp_path):
    good = write_csv(tmp_path / "pairs.csv", ellipsoid_pairs(20, 0.1))
    bad = tmp_path / "bad.txt"
    bad.write_text("3\n1 2", encoding="utf-8")
    cases = [
        ([tmp_path / "none.txt"], 3),
        ([bad], 3),
        ([good, "--figure", tmp_path / "x.bmp"], 2),
        ([good, "-o", tmp_path / "no" / "x.toml"], 2),
        ([good, "--train-share", "0.05"], 3),
    ]
    for arguments, code in cases:
        ended = called(main, *arguments, "--splits", "1", "--kind", "ellipsoid")
        assert (ended.code, ended.one_line) == (code, True)
        assert ended.err.startswith("plan-identify: ")
    for option in ("--splits=0", "--rho-mm=0", "--rho-mm=inf", "--train-share=1", "--kind=cube"):
        assert called(main, good, option).code == 2


def scaled_at_random(pairs: pushes.Pairs, seed: int = 5) -> pushes.Pairs:
    """The pairs, each wrench and each twist multiplied by a random factor, which keeps its direction."""
    rng = np.random.default_rng(seed)
    factors = np.exp(rng.normal(scale=2.0, size=(2, len(pairs.weights), 1)))
    return pairs._replace(wrenches=factors[0] * pairs.wrenches, twists=factors[1] * pairs.twists)


def in_rho(pairs: pushes.Pairs) -> pushes.Pairs:
    return pairs._replace(wrenches=pairs.wrenches / [1, 1, RHO], twists=pairs.twists * [1, 1, RHO])


@pytest.mark.parametrize("kind", ["ellipsoid", "quartic"])
def test_fit_of_directions_alone_recovers_an_exact_ellipsoid(kind):
    data = identify.directions(in_rho(scaled_at_random(ellipsoid_pairs(60, 0.0))))
    result = identify.fit(data, RHO, kind, np.random.default_rng(0))
    F = np.random.default_rng(1).normal(size=(200, 3))
    errors = identify.angles(identify.predict(result.surface, F), limit_surface.twist(A, F))
    assert np.degrees(errors).max() < 1.0
    assert result.friction_n is None
