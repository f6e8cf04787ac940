"""Identifies a limit surface from measured wrench-twist pairs, and tests it on unseen pairs.

Wrenches are normalised by the friction force with the table (mu N), which a log does not contain. Unless the
user states mu N, it is estimated from the fitted ellipsoid: as the force that slides the part without turning
it, averaged over directions. If only the direction of wrenches is known, each wrench is scaled onto the
fitted surface instead.

The quartic is fitted robustly, with a ridge that pulls it towards the ellipsoid. The strongest ridge is taken
whose cross-validated error is within one standard error of the least error (Hastie, Tibshirani and Friedman,
"The Elements of Statistical Learning", 7.10). If only the directions of wrenches are known, the ridge of
least error is taken, since such data have many pairs.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.random import Generator

from planner.arrays import Array, take
from planner.identification.pushes import Pairs
from planner.mechanics import limit_surface, quartic_fit
from planner.mechanics.limit_surface import LimitSurface
from planner.mechanics.quartic import QuarticSurface
from planner.work.progress import Report, silent
from runtime.shell.errors import InputError

Kind = Literal["ellipsoid", "quartic"]
Surface = LimitSurface | QuarticSurface

RIDGES = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)  # pulls towards the ellipsoid [pairs]

FOLDS = 5
LEAST_PAIRS = 12  # least number of pairs; a split fits to at least half of it

_FRICTION_ROUNDS = 5
_SCALING_ROUNDS = 8
_QUARTIC_ROUNDS = 2


class Normalised(NamedTuple):
    """Wrench-twist pairs with torques and angles scaled by rho, and with twists of length 1."""

    F: Array  # (K, 3) [fx, fy, tau / rho], still in N
    V: Array  # (K, 3) unit [vx, vy, omega rho]
    weights: Array  # (K,) weights of the pairs, with mean 1


class Directions(Normalised):
    """Pairs of which only the direction of the wrenches is known; F holds unit wrenches."""


class Fit(NamedTuple):
    """A fitted surface with the parameters of the fit."""

    surface: Surface  # the limit surface, of wrenches divided by `friction_n`
    friction_n: float | None  # friction force with the table [N]; None: wrenches are directions
    ridge: float  # pull towards the ellipsoid [pairs]; 0 for an ellipsoid


class Identified(NamedTuple):
    """An identified limit surface, and how well its kind predicts unseen pushes."""

    kind: Kind  # "ellipsoid" or "quartic"
    fit: Fit  # fit to all pairs
    errors_rad: Array  # (splits,) mean angle between measured and predicted held-out twists
    held_out: Array  # (K, 3) mean unit twist predicted for each held-out pair; nan for the others
    fit_error_rad: float  # mean angle between measured and predicted twists of all pairs, by `fit`


def normalise(pairs: Pairs, rho_mm: float) -> Normalised:
    """Divides the torques of pairs by rho, multiplies angles by rho, and scales the twists to length 1."""
    F = pairs.wrenches / [1.0, 1.0, rho_mm]
    V = pairs.twists * [1.0, 1.0, rho_mm]
    return Normalised(F, _unit(V), pairs.weights / pairs.weights.mean())


def directions(pairs: Pairs) -> Directions:
    """Scales the wrenches and twists of pairs to length 1."""
    weights = pairs.weights / pairs.weights.mean()
    return Directions(_unit(pairs.wrenches), _unit(pairs.twists), weights)


def _unit(rows: Array) -> Array:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def identify(
    data: Normalised,
    rho_mm: float,
    kinds: Sequence[Kind],
    *,
    splits: int,
    train_share: float,
    seed: int,
    friction_n: float | None = None,
    report: Report = silent,
) -> list[Identified]:
    """Fits limit surfaces to pairs, normalised with `rho_mm`, and tests each kind on the same random splits.

    Args:
        data: the normalised pairs.
        rho_mm: the length that torques were divided by.
        kinds: kinds of surfaces to fit.
        splits: number of random splits.
        train_share: share of the pairs, 0 to 1, that are used to fit in each split; the others are held out.
        seed: seed of the splits and of cross-validation.
        friction_n: friction with the table [N]; None: estimated from the pairs of each fit.
        report: receives the progress.

    Returns:
        The fit to all pairs and the errors of each kind, in the order of `kinds`.

    Raises:
        InputError: too few pairs, to fit or to hold out.
        QuarticFitError: the conic solver fails.
    """
    count = len(data.F)
    train = round(train_share * count)
    if count < LEAST_PAIRS or train < LEAST_PAIRS // 2 or train >= count:
        problem = f"{count} pairs, {train} of them to fit; give at least {LEAST_PAIRS} pairs"
        least = f"fit to at least {LEAST_PAIRS // 2} of them, but not all"
        raise InputError(f"{problem} and {least}", key="train_share")
    errors = {kind: np.empty(splits) for kind in kinds}
    predicted = {kind: np.zeros((count, 3)) for kind in kinds}
    for split, seeds in enumerate(np.random.SeedSequence(seed).spawn(splits)):
        report("splitting", split, splits)
        order = np.random.default_rng(seeds).permutation(count)
        known, unseen = take(data, order[:train]), take(data, order[train:])
        for kind in kinds:
            fitted = fit(known, rho_mm, kind, np.random.default_rng(seeds.spawn(1)[0]), friction_n)
            twists = predict(fitted.surface, unseen.F)
            errors[kind][split] = np.average(angles(twists, unseen.V), weights=unseen.weights)
            predicted[kind][order[train:]] += twists
    report("fitting all pairs", splits, splits)
    results = []
    for kind in kinds:
        fitted = fit(data, rho_mm, kind, np.random.default_rng(seed), friction_n)
        residual = np.average(angles(predict(fitted.surface, data.F), data.V), weights=data.weights)
        length = np.linalg.norm(predicted[kind], axis=1, keepdims=True)
        unseen_yet = np.full((count, 3), np.nan)
        mean = np.divide(predicted[kind], length, out=unseen_yet, where=length > 0.0)
        results.append(Identified(kind, fitted, errors[kind], mean, float(residual)))
    return results


def fit(
    data: Normalised, rho_mm: float, kind: Kind, rng: Generator, friction_n: float | None = None
) -> Fit:
    """Fits one surface to pairs; cross-validation on these pairs chooses the ridge of a quartic.

    Raises:
        QuarticFitError: the conic solver fails.
    """
    if isinstance(data, Directions):
        return _fit_directions(data, rho_mm, kind, rng)
    scale = friction(data) if friction_n is None else friction_n
    scaled = data._replace(F=data.F / scale)
    if kind == "ellipsoid":
        A = limit_surface.fit(scaled.F, scaled.V, scaled.weights)
        return Fit(LimitSurface(A, rho_mm), scale, 0.0)
    ridge = choose_ridge(scaled, rho_mm, rng)
    return Fit(_quartic(scaled, rho_mm, ridge), scale, ridge)


def _fit_directions(data: Directions, rho_mm: float, kind: Kind, rng: Generator) -> Fit:
    """Fits a surface to wrenches of unknown magnitude.

    Scales the wrenches onto the fitted surface and fits again, several times.
    """
    A, emphasis = np.eye(3), data.weights
    for _ in range(_SCALING_ROUNDS):
        scaled = Normalised(_onto_ellipsoid(data.F, A), data.V, data.weights)
        A = limit_surface.fit(scaled.F, scaled.V, emphasis)
        emphasis = data.weights * quartic_fit.emphasis(scaled.F @ A, data.V)
    if kind == "ellipsoid":
        return Fit(LimitSurface(A, rho_mm), None, 0.0)
    scaled = scaled._replace(F=_onto_ellipsoid(data.F, A))
    ridge = choose_ridge(scaled, rho_mm, rng, 0.0)
    surface = _quartic(scaled, rho_mm, ridge)
    for _ in range(_QUARTIC_ROUNDS):
        scaled = scaled._replace(F=scaled.F / surface.value(scaled.F)[:, None] ** 0.25)
        surface = _quartic(scaled, rho_mm, ridge)
    return Fit(surface, None, ridge)


def _onto_ellipsoid(F: Array, A: Array) -> Array:
    return np.asarray(F / np.sqrt(np.einsum("ki,ij,kj->k", F, A, F))[:, None])


def friction(data: Normalised) -> float:
    """Estimates mu N [N]: the mean force that slides the part without turning it.

    Begins with a guess and improves it several times: divides the wrenches by mu N, and fits an ellipsoid A
    to them. According to A, a translation along the unit vector v takes the force sqrt(v^T A^-1 v) along v.
    With the right mu N the root mean square of this force over all v is 1, so mu N is multiplied by it.
    """
    scale = float(np.median(np.hypot(data.F[:, 0], data.F[:, 1])))
    for _ in range(_FRICTION_ROUNDS):
        A = limit_surface.fit(data.F / scale, data.V, data.weights)
        scale *= math.sqrt(0.5 * float(np.trace(np.linalg.inv(A)[:2, :2])))
    return scale


def choose_ridge(data: Normalised, rho_mm: float, rng: Generator, tolerance: float = 1.0) -> float:
    """Chooses the strongest of `RIDGES` whose cross-validated error is nearly the least.

    The error may exceed the least error by `tolerance` standard errors of the least error.
    """
    count = len(data.F)
    errors = np.empty((len(RIDGES), count))
    order = rng.permutation(count)
    for fold in range(FOLDS):
        unseen = order[fold::FOLDS]
        known = take(data, np.setdiff1d(order, unseen))
        for row, ridge in enumerate(RIDGES):
            twists = _quartic(known, rho_mm, ridge).twist(data.F[unseen])
            errors[row, unseen] = angles(twists, data.V[unseen])
    errors *= data.weights
    mean = errors.mean(axis=1)
    best = int(np.argmin(mean))
    most = mean[best] + tolerance * errors[best].std() / math.sqrt(count)
    return max(ridge for ridge, error in zip(RIDGES, mean, strict=True) if error <= most)


def predict(surface: Surface, F: Array) -> Array:
    """Returns the predicted unit twists (K, 3) of wrenches F (K, 3); the scale of F does not matter."""
    if isinstance(surface, LimitSurface):
        return limit_surface.twist(surface.A, F)
    return surface.twist(F)


def angles(first: Array, second: Array) -> Array:
    """Returns the angles (K,) between unit vectors (K, 3), rad."""
    return np.asarray(np.arccos(np.clip((first * second).sum(axis=1), -1.0, 1.0)))


def _quartic(data: Normalised, rho_mm: float, ridge: float) -> QuarticSurface:
    return quartic_fit.fit(data.F, data.V, rho_mm, data.weights, ridge=ridge, robust=True)
