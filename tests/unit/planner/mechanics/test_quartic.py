"""Convex quartics: Euler's identities, certificates, fits to known loads, and samples that stay convex."""

import numpy as np
import pytest
from problems import rectangle
from surfaces import hessian, mean_twist_error, random_ellipsoid

from planner.mechanics import limit_surface, quartic, quartic_fit
from planner.mechanics.quartic import QuarticSurface
from planner.part import outline, quartic_form
from planner.part.pressure import Pressure, support
from planner.part.quartic_form import coefficients_of

RHO = outline.radius_of_gyration(rectangle())
TWISTS = limit_surface.twist_directions()


def least_curvature(coefficients: np.ndarray, directions: np.ndarray) -> float:
    """The least eigenvalue of the Hessian over many directions; negative: the quartic is not convex."""
    surface = QuarticSurface(coefficients, np.eye(9), 1.0)
    return float(np.linalg.eigvalsh(hessian(surface, directions)).min())


@pytest.fixture(scope="module", params=["boundary", "uniform"])
def load(request):
    return support(Pressure(request.param, 100), rectangle())


@pytest.fixture(scope="module")
def fitted(load):
    return quartic_fit.fit_pressure(*load, RHO)


def test_of_ellipsoid_has_the_squared_value_and_its_gradient():
    rng = np.random.default_rng(0)
    A, F = random_ellipsoid(rng), rng.normal(size=(20, 3))
    surface = quartic.of_ellipsoid(A, 10.0)
    level = np.einsum("ki,ij,kj->k", F, A, F)
    assert np.allclose(surface.value(F), level**2, rtol=1e-12)
    assert np.allclose(surface.gradient(F), 4 * level[:, None] * (F @ A), rtol=1e-10, atol=1e-12)
    assert np.allclose(surface.twist(F), limit_surface.twist(A, F), atol=1e-12)


def test_quartic_is_a_local_ellipsoid_by_eulers_theorem(fitted):
    """By Euler's theorem, F . grad H = 4 H and hess H F = 3 grad H for a quartic H at a wrench F.

    So the wrench causes the same twist as on an ellipsoid with the positive definite matrix hess H / 3.
    """
    F = np.random.default_rng(1).normal(size=(50, 3))
    gradient = fitted.gradient(F)
    assert np.allclose((F * gradient).sum(axis=1), 4 * fitted.value(F), rtol=1e-12)
    local = hessian(fitted, F) / 3
    assert np.allclose(np.einsum("kij,kj->ki", local, F), gradient, rtol=1e-9, atol=1e-9)
    for A, f, v in zip(local, F, fitted.twist(F), strict=True):
        assert np.allclose(limit_surface.twist(A, f), v, atol=1e-12)


def test_gradient_and_hessian_equal_finite_differences(fitted):
    F = np.random.default_rng(2).normal(size=(10, 3))
    for k, e in enumerate(1e-5 * np.eye(3)):
        slope = (fitted.value(F + e) - fitted.value(F - e)) / 2e-5
        assert np.allclose(fitted.gradient(F)[:, k], slope, rtol=1e-6, atol=1e-7)
        slopes = (fitted.gradient(F + e) - fitted.gradient(F - e)) / 2e-5
        assert np.allclose(hessian(fitted, F)[:, k], slopes, rtol=1e-6, atol=1e-6)


def test_certificate_of_fit_is_the_hessian_and_positive_definite(fitted):
    rng = np.random.default_rng(3)
    z, F = rng.normal(size=(2, 40, 3))
    y = np.einsum("ka,ki->kai", z, F).reshape(-1, 9)
    curvature = np.einsum("ka,kab,kb->k", z, hessian(fitted, F), z)
    assert np.allclose(np.einsum("ki,ij,kj->k", y, fitted.certificate, y), curvature, rtol=1e-9)
    assert np.linalg.eigvalsh(fitted.certificate)[0] > 0
    assert quartic_form.certifies(fitted.certificate, fitted.coefficients)
    assert np.allclose(coefficients_of(fitted.certificate), fitted.coefficients, rtol=1e-12)
    assert not fitted.coefficients.flags.writeable


def test_fit_pressure_predicts_twists_better_than_the_ellipsoid(load, fitted):
    F = limit_surface.wrenches(*load, RHO, TWISTS)
    even = limit_surface.fit_ellipsoid(*load, RHO)
    ellipsoid = mean_twist_error(limit_surface.twist(even.A, F), TWISTS)
    assert mean_twist_error(fitted.twist(F), TWISTS) < 0.5 * ellipsoid
    assert np.abs(fitted.value(F) - 1).max() < 0.2


def test_fit_exact_pairs_of_a_quartic_recovers_it():
    rng = np.random.default_rng(5)
    truth = quartic.of_ellipsoid(random_ellipsoid(rng), 10.0)
    mixed = truth.certificate + quartic.of_ellipsoid(random_ellipsoid(rng), 10.0).certificate
    truth = quartic.from_certificate(mixed, 10.0)
    F = rng.normal(size=(60, 3))
    F /= truth.value(F)[:, None] ** 0.25
    V = truth.gradient(F) * rng.uniform(0.1, 10.0, size=(60, 1))
    result = quartic_fit.fit(F, V, 10.0)
    near = 1e-4 * np.abs(truth.coefficients).max()
    assert np.allclose(result.coefficients, truth.coefficients, atol=near)
    assert mean_twist_error(result.twist(F), V) < 1e-3


def test_fit_pressure_is_the_minimum_among_convex_quartics(load, fitted):
    """Mixing in another convex quartic does not improve the fit. Any such mixture is convex, too."""
    F = limit_surface.wrenches(*load, RHO, TWISTS)

    def cost(coefficients: np.ndarray) -> float:
        gradient = quartic_form.gradient_rows(F) @ coefficients / 4
        across = gradient - TWISTS * (gradient * TWISTS).sum(axis=1, keepdims=True)
        return float(
            ((quartic_form.monomials(F) @ coefficients - 1) ** 2).sum() + (across**2).sum()
        )

    others = drawn(fitted, 100, 20, 6)
    least = cost(fitted.coefficients)
    for other in others:
        assert cost(0.99 * fitted.coefficients + 0.01 * other) > least - 1e-6 * len(F)


def test_certifies_nonconvex_quartic_is_refused(fitted):
    bent = coefficients_of(np.diag([0.0, 1, 0, 0, 0, 0, 0, 0, 0]))  # fx^2 fy^2 is not convex
    assert least_curvature(bent, TWISTS) < 0
    for Q in (fitted.certificate, quartic_form.gram(bent)):
        assert not quartic_form.certifies(Q, bent)
    with pytest.raises(ValueError, match="not positive definite"):
        quartic.from_certificate(quartic_form.gram(bent), 1.0)


def drawn(surface, dof, n, seed):
    """Coefficients (n, 15) of random quartics about a surface.

    Each quartic H is recovered from its sampled Hessian h, since F^T h(F) F = 12 H(F) at each wrench F.
    """
    tables = quartic.sample(surface, dof, np.random.default_rng(seed), n)
    F = np.random.default_rng(seed).normal(size=(40, 3))
    products = F[:, quartic_form.PAIRS[:, 0]] * F[:, quartic_form.PAIRS[:, 1]]
    twice = products * np.where(quartic_form.PAIRS[:, 0] == quartic_form.PAIRS[:, 1], 1.0, 2.0)
    values = np.einsum("kp,npq,kq->nk", twice, tables, products) / 12.0
    return np.linalg.lstsq(quartic_form.monomials(F), values.T, rcond=None)[0].T


def test_sample_of_squared_ellipsoid_equals_squared_wishart_draws():
    A = np.round(random_ellipsoid(np.random.default_rng(3)), 6)
    squared = quartic.of_ellipsoid(A, 10.0)
    coefficients = drawn(squared, 12, 50, 11)
    for ellipsoid, row in zip(
        limit_surface.wishart(A, 12, np.random.default_rng(11), 50), coefficients, strict=True
    ):
        expected = quartic.of_ellipsoid(ellipsoid, 10.0).coefficients
        assert np.allclose(row, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("dof", [3, 12, 100])
def test_sample_with_any_degrees_of_freedom_is_convex(fitted, dof):
    coefficients = drawn(fitted, dof, 100, 12)
    for row in coefficients:
        assert least_curvature(row, TWISTS) > -1e-9 * np.abs(row).max()
