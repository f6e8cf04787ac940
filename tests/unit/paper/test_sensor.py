"""The sensor model against scikit-learn, against geometry, and what its error means."""

import math

import numpy as np
import problems
import pytest
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from planner.learned.region import stands_on
from planner.paper import flat_tree
from planner.paper.sensor import HELD_OUT, SensorModel, features


def rolled(outline, n, seed, release=(0.0, 0.0, 0.0)):
    simulator = problems.simulator(outline, workers=2)
    rng = np.random.default_rng(seed)
    poses = problems.random_poses(rng, n, 30.0)
    poses = poses[~stands_on(simulator.outline, simulator.jaws, poses)]
    parameters = simulator.sample(len(poses), rng)
    noise = rng.standard_normal((len(poses), 3)) * np.array(release)
    return simulator.roll_out(poses, parameters._replace(release=noise))


@pytest.fixture(scope="module")
def rectangle():
    return rolled(problems.rectangle(), 15_000, 1)


@pytest.fixture(scope="module")
def model(rectangle):
    return SensorModel.fit(rectangle.poses, rectangle.width_mm, order=2)


def test_flat_trees_say_what_scikit_learn_says_bit_by_bit():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(3000, 4)).astype(np.float32)
    X[:200] = X[200:400]  # rows on thresholds and ties
    y = X[:, 0] * X[:, 1] + 0.1 * rng.normal(size=len(X))
    asked = np.concatenate([X, rng.normal(size=(3000, 4)).astype(np.float32)])
    regressor = DecisionTreeRegressor(min_samples_leaf=3, random_state=0).fit(X, y)
    assert np.array_equal(flat_tree.regression(regressor).predict(asked), regressor.predict(asked))
    classifier = DecisionTreeClassifier(min_samples_leaf=7, random_state=0).fit(X, y > 0.2)
    shares = flat_tree.probability(classifier, True)
    assert np.array_equal(shares.predict(asked), classifier.predict_proba(asked)[:, 1])
    assert shares.leaves == classifier.get_n_leaves()


def test_rows_on_a_threshold_go_left():
    X = np.array([[0.0], [1.0], [2.0], [3.0]], dtype=np.float32)
    fitted = DecisionTreeRegressor(random_state=0).fit(X, [0.0, 0.0, 1.0, 1.0])
    on = np.array([[fitted.tree_.threshold[0]]], dtype=np.float32)
    beside = np.nextafter(on, np.float32(9.0))
    tree = flat_tree.regression(fitted)
    assert tree.predict(on)[0] == 0.0
    assert tree.predict(beside)[0] == 1.0


def test_the_model_predicts_widths_it_never_saw(model):
    fresh = rolled(problems.rectangle(), 6000, 2)
    error = np.abs(model.predict(fresh.poses) - fresh.width_mm)
    # The encoder's noise is 0.15 mm and its counts are 0.37 mm wide.
    assert np.median(error) < 0.05
    assert np.quantile(error, 0.95) < 0.25
    # The error that the model states is the error it has.
    assert np.quantile(error, 0.95) == pytest.approx(model.error.q95_mm, rel=0.3)
    assert model.error.median_mm <= model.error.q95_mm <= model.error.worst_mm
    assert model.error.rms_mm <= model.error.worst_mm


def test_flush_grasps_and_jams_show_the_widths_that_geometry_says(model):
    # Between the fingers the rectangle at angle t is 30 |sin t| + 21 |cos t| wide; it rests flush, or jams
    # where friction holds it on a diagonal.
    for turn, width in ((0.0, 21.0), (math.pi / 2, 30.0), (math.pi - 0.95, math.hypot(30.0, 21.0))):
        for copy in (turn, turn + math.pi, turn - math.pi):
            assert model.predict(np.array([[0.0, 0.0, copy]]))[0] == pytest.approx(width, abs=0.5)
    far = np.array([[40.0, 0.0, 0.3], [-45.0, 3.0, 1.0]])
    assert np.array_equal(model.predict(far), [0.0, 0.0])


def test_equal_turns_are_one_place(model, rectangle):
    poses = rectangle.poses[:500]
    turned = poses + np.array([0.0, 0.0, math.pi])
    differ = np.abs(model.predict(turned) - model.predict(poses)) > 0.0
    assert np.mean(differ) < 0.01  # rounding on a threshold alone
    assert np.allclose(features(turned, 2), features(poses, 2), atol=1e-5)


def test_release_noise_asks_for_larger_leaves():
    shaken = rolled(problems.rectangle(), 8000, 3, release=(0.5, 0.5, math.radians(2.0)))
    noisy = SensorModel.fit(shaken.poses, shaken.width_mm, order=2)
    assert noisy.leaf_size > 1
    assert noisy.error.median_mm < 0.5


def test_too_few_roll_outs_are_refused():
    with pytest.raises(ValueError, match="9 roll-outs"):
        SensorModel.fit(np.zeros((HELD_OUT - 1, 3)), np.zeros(HELD_OUT - 1), 1)


def test_same_roll_outs_give_the_same_model(model, rectangle):
    again = SensorModel.fit(rectangle.poses, rectangle.width_mm, order=2)
    assert all(np.array_equal(a, b) for a, b in zip(again.tree, model.tree, strict=True))
    assert again.error == model.error
