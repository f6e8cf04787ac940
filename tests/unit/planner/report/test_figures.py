"""The pictures of the documentation show the committed results of the benchmarks."""

import json
import re
from xml.etree import ElementTree

import charts
import movie
import numpy as np
import pytest
from launch import RESULTS

from planner.report.replay import replay

pytestmark = pytest.mark.slow


def test_picture_animates_a_part_that_the_table_locates(table, job):
    drawn = ElementTree.fromstring(movie.picture(table, job, replay(table, job, 2000, 0)))
    moves = [part for part in drawn.iter() if part.tag.endswith(("animate", "animateTransform"))]
    assert len({move.get("dur") for move in moves}) == 1
    for move in moves:
        keys = [float(key) for key in move.get("keyTimes").split(";")]
        assert keys == sorted(keys)
        assert (keys[0], keys[-1]) == (0.0, 1.0)
        assert len(keys) == len(move.get("values").split(";"))
    message = " ".join(drawn.itertext())
    assert message.count("the encoder reads") == 3
    assert float(re.search(r"off by (\S+) mm", message)[1]) < job.goal.distance_mm


def test_calibration_and_worst_pushes_draw_the_kept_results():
    kept = json.loads((RESULTS / "contact.json").read_text())
    nine_tenths = kept["nominal"].index(0.9)
    for axes, name in zip(charts.calibration(kept).axes, ("x", "y", "turn"), strict=True):
        for group, line in zip(charts.GROUPS, axes.lines[1:], strict=True):
            shown = line.get_xydata()[nine_tenths]
            assert shown == pytest.approx([90.0, 100 * kept["groups"][group]["coverage"][name]])
    for axes, row in zip(charts.worst_pushes(kept).axes, kept["worst"], strict=True):
        start, measured, predicted, _ = (line.get_xydata()[:-1] for line in axes.lines)
        assert start == pytest.approx(np.array(row["outline_mm"]))
        off_mm = np.hypot(*(measured - predicted).T)  # of the corners, which surround the centroid
        assert off_mm.min() < row["mm"] < off_mm.max()
        assert f"{row['mm']:.0f} mm" in axes.get_title()
