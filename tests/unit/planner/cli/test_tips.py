"""`plan-simulate --push --tip-radius-mm`: round tips, tips that start inside the part, random draws."""

import numpy as np
import pytest
import shapely
from push_commands import JOB, NOMINAL, run

from planner.cli import tips
from planner.mechanics.push import Paths
from runtime.shell.errors import InputError

TIPS = "tip_x_mm,tip_y_mm,way_x_mm,way_y_mm"
RADIUS = ("--tip-radius-mm", "4.75")
OUTPUTS = ["moved_x_mm", "moved_y_mm", "turned_deg"]


def moved(row):
    return [float(row[name]) for name in OUTPUTS]


def test_simulate_push_round_tip_moves_the_part_in_the_outline_frame(tmp_path):
    """The first push meets the part after 1 mm and goes through its centroid; the second misses the part."""
    text = f"{TIPS},note\n-5.75,50,21,0,a\n-5.75,-5.75,0,-30,b\n"
    code, rows, out, err = run(tmp_path, text, *NOMINAL, *RADIUS)
    assert (code, err) == (0, "")
    assert "2 pushes: 1 stuck, 1 untouched" in out
    assert list(rows[0]) == [*TIPS.split(","), *OUTPUTS, "status", "overlap_mm"]
    assert moved(rows[0])[0] == pytest.approx(20.0, abs=0.1)
    assert moved(rows[1]) == [0.0, 0.0, 0.0]
    assert [row["status"] for row in rows] == ["stuck", "untouched"]
    assert [float(row["overlap_mm"]) for row in rows] == [0.0, 0.0]


@pytest.mark.parametrize("deep", [2.0, 9.0])
def test_simulate_push_overlapping_tip_moves_the_part_like_a_clear_one(tmp_path, deep):
    clear, inside = "-4.75,40,15,4", f"{deep - 4.75},40,15,4"
    _, rows, _, _ = run(tmp_path, f"{TIPS}\n{clear}\n{inside}\n", *NOMINAL, *RADIUS)
    assert float(rows[1]["overlap_mm"]) == pytest.approx(deep)
    assert moved(rows[1]) == pytest.approx(moved(rows[0]), abs=0.01)


def test_simulate_push_overlap_by_the_tip_diameter_is_refused(tmp_path):
    code, rows, _, err = run(tmp_path, f"{TIPS}\n-9,40,9,0\n9.5,40,9,0\n", *NOMINAL, *RADIUS)
    assert code == InputError.exit_code
    assert "in.csv: push 2: the tip overlaps the part by" in err
    assert err.count("\n") == 1
    assert rows == []


def test_beside_overlapping_tips_leave_notches_by_the_shortest_way():
    outline = np.array([[0.0, 0], [40, 0], [40, 12], [12, 12], [12, 40], [0, 40]])
    rng, part, radius = np.random.default_rng(2), shapely.Polygon(outline), 3.0
    ring = part.buffer(radius - 0.01)
    points = rng.uniform(-2.0, 42.0, (400, 2))
    away = shapely.distance(part.exterior, shapely.points(points))
    points = points[~shapely.contains(part, shapely.points(points)) | (away < radius)]
    n = len(points)
    pushes = Paths(points[:, None], points, np.zeros(n), np.ones((n, 2)))
    freed = tips.beside(pushes, radius, outline, "here")
    starts = freed.paths.points[:, 0]
    assert not shapely.contains(ring, shapely.points(starts)).any()
    inside = shapely.contains(part.buffer(radius), shapely.points(points))
    assert (starts[~inside] == points[~inside]).all()
    assert ((freed.overlap_mm > 0.0) == inside).all()
    shifted = np.hypot(*(starts - points).T)
    assert (shifted >= freed.overlap_mm - 0.01).all()
    edge = part.buffer(radius, quad_segs=64).exterior
    shortest = shapely.distance(edge, shapely.points(points[inside]))
    assert shifted[inside] == pytest.approx(shortest, abs=0.01)


def test_simulate_push_start_scatter_widens_the_interval_of_turns(tmp_path):
    """All draws have nearly the same limit surface; the turn depends on the scattered start of the tip."""
    text, options = f"{TIPS}\n-4.75,50,20,0\n", (*RADIUS, "--draws", "200")
    steady, widths = JOB.replace("pressure = {", "pressure = { wishart_dof = 100000,"), []
    for start_mm in (0.0, 2.0):
        _, rows, _, _ = run(tmp_path, text, *options, "--start-mm", str(start_mm), job=steady)
        widths.append(float(rows[0]["turned_deg_high"]) - float(rows[0]["turned_deg_low"]))
    assert widths[1] > 2.0 * widths[0]


@pytest.mark.parametrize(
    "options",
    [
        ("--tip-radius-mm", "0"),
        ("--tip-radius-mm", "-1"),
        ("--tip-radius-mm", "nan"),
        ("--tip-radius-mm", "2000"),
        (*RADIUS, "--start-mm", "1"),  # without draws
        (*RADIUS, "--start-mm", "11"),
        (*RADIUS, "--draws", "0"),
        (*RADIUS, "--draws", "9"),  # together with --nominal
        (*RADIUS, "--draws", "1000000000"),
    ],
)
def test_simulate_push_invalid_tip_options_are_refused(tmp_path, options):
    code, rows, _, err = run(tmp_path, f"{TIPS}\n-9,2,3,1\n", *NOMINAL, *options)
    assert code == 2
    assert rows == []
    assert "--" in err
