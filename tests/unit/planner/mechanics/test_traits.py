"""Deviations of outlines, and squeezes of parts with such deviations."""

import numpy as np
import problems
import pytest
import shapely
from problems import OUTLINES

from planner.mechanics.simulator import Simulator
from planner.mechanics.traits import SHAPES, shapes
from planner.part.outline import grown, offsets


@pytest.mark.parametrize("name", OUTLINES)
def test_offsets_grow_the_area_by_the_perimeter(name):
    outline, mm = OUTLINES[name](), 1e-4
    polygon = shapely.Polygon(outline)
    more = shapely.Polygon(outline + mm * offsets(outline)).area - polygon.area
    assert more == pytest.approx(mm * polygon.length, rel=1e-3)
    assert grown(outline, 0.0) == pytest.approx(outline, abs=1e-9)


def test_roll_out_deviating_part_equals_a_part_drawn_so():
    n, rng = 300, np.random.default_rng(1)
    part = problems.simulator(problems.rectangle())
    poses = np.column_stack([rng.uniform(-8, 8, (n, 2)), rng.uniform(-np.pi, np.pi, n)])
    deviation = 0.2 * rng.standard_normal(SHAPES)
    ours = part.outline + np.tensordot(deviation, shapes(part.outline), axes=1)

    def rolled(outline, bases, off):
        built = part.surface, part.jaws, part.friction, part.wishart_dof
        simulator = Simulator(outline, *built, shapes=bases, workers=1)
        parameters = simulator.sample(n, np.random.default_rng(2))
        return simulator.roll_out(poses, parameters._replace(deviation=np.tile(off, (n, 1))))

    drawn = rolled(ours, np.zeros((0, len(ours), 2)), np.zeros(0))
    deviating = rolled(part.outline, shapes(part.outline), deviation)
    assert deviating.poses == pytest.approx(drawn.poses, abs=1e-6)
    assert deviating.width_mm == pytest.approx(drawn.width_mm, abs=1e-6)
