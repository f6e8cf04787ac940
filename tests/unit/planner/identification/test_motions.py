"""Identification from motions alone: simulated pushes whose surface and friction are known."""

import numpy as np
import pytest
from problems import rectangle, simulator
from programs import called, document

from planner.cli.identify import main
from planner.identification import motions
from planner.mechanics.push import Paths
from runtime.shell.errors import InputError

pytestmark = pytest.mark.slow

A = np.array([[1.0, 0.1, -0.1], [0.1, 1.2, 0.15], [-0.1, 0.15, 0.7]])
MU, TIP_MM = 0.22, 3.0
JOB = """
part = { name = "rectangle", outline_mm = [[0, 0], [30, 0], [30, 21], [0, 21]] }
friction = { finger_part_min = 0.1, finger_part_max = 0.3 }
gripper = { finger_length_mm = 20, finger_width_mm = 10, opening_mm = 85 }
uncertainty = { radius_mm = 10, orientation = "unknown" }
actions = { angles_deg = [0], centers_mm = [[0, 0]] }
goal = { distance_mm = 3, confidence = 0.9 }
pressure = { kind = "uniform" }
"""


def known(n: int, noise_mm: float) -> motions.Motions:
    """Simulated pushes of the rectangle by about 20 mm, with known limit surface and friction."""
    rng = np.random.default_rng(7)
    angle = rng.uniform(-np.pi, np.pi, n)
    away = np.column_stack([np.cos(angle), np.sin(angle)])
    starts, aside = 24.0 * away, rng.uniform(-7.0, 7.0, (n, 1)) * away[:, ::-1] * [-1.0, 1.0]
    starts = starts + aside
    paths = Paths(starts[:, None], starts, np.zeros(n), -28.0 * away)
    part = simulator(rectangle())
    truth = part.nominal(n, MU)._replace(surfaces=np.repeat(A[None], n, axis=0))
    moved = part.push(paths, truth, TIP_MM).moved
    return motions.Motions(paths, moved + noise_mm * rng.normal(size=(n, 3)) * [1.0, 1.0, 0.1])


@pytest.mark.parametrize(("noise_mm", "close"), [(0.0, 0.03), (0.3, 0.15)])
def test_fit_motions_recovers_surface_and_friction(noise_mm, close):
    fitted = motions.fit(known(60, noise_mm), simulator(rectangle()), TIP_MM)
    assert fitted.friction == pytest.approx(MU, abs=close)
    assert pytest.approx(A, abs=2.0 * close) == fitted.surface.A


def test_fit_outliers_among_motions_change_friction_little():
    spoiled = known(60, 0.1)
    spoiled.moved[::12] += [9.0, -9.0, 0.5]
    fitted = motions.fit(spoiled, simulator(rectangle()), TIP_MM)
    assert fitted.friction == pytest.approx(MU, abs=0.1)


def test_fit_pushes_that_move_nothing_say_nothing():
    seen = known(12, 0.0)
    seen.moved[5:] = 0.0
    with pytest.raises(InputError, match="5 of 12 pushes move the part"):
        motions.fit(seen, simulator(rectangle()), TIP_MM)


HEADER = "tip_x_mm,tip_y_mm,way_x_mm,way_y_mm,moved_x_mm,moved_y_mm,turned_deg"


@pytest.fixture
def words(tmp_path):
    """Options of plan-identify with a table of motions and a job."""
    data, table, job = known(40, 0.1), tmp_path / "pushes.csv", tmp_path / "job.toml"
    job.write_text(JOB)
    tips = data.paths.points[:, 0] + [15.0, 10.5]  # from the centroid
    moved = data.moved * [1.0, 1.0, 180.0 / np.pi]
    rows = np.column_stack([tips, data.paths.shifts, moved])
    np.savetxt(table, rows, delimiter=",", header=HEADER, comments="")
    return ["--motions", str(table), "--job", str(job), "--tip-radius-mm", "3", "--splits", "2"]


def test_identify_command_motions_states_friction_and_writes_surface(words, tmp_path):
    surface = tmp_path / "surface.toml"
    answer = document(main, *words, "--json", "-o", surface)
    assert answer["friction"] == pytest.approx(MU, abs=0.1)
    assert answer["held_out_error_mm"] < 2.0
    assert "ellipsoid" in surface.read_text()


def test_identify_command_motions_with_missing_or_other_options_is_refused(words):
    for spoiled in (words[:4], words[:2] + words[4:], [*words, "--pairs", words[1]]):
        ended = called(main, *spoiled)
        assert (ended.code, ended.one_line) == (2, True)


def test_identify_command_too_few_motions_is_refused(words, tmp_path):
    (tmp_path / "pushes.csv").write_text(HEADER + "\n" + "1,2,3,4,5,6,7\n" * 11)
    ended = called(main, *words)
    assert ended.code == 3
    assert "11 pushes; give at least 12" in ended.err
