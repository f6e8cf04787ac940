"""The pictures of the documentation: they show what is kept, no text covers another, files are small."""

import re
from xml.etree import ElementTree

import movie
import pytest

from planner.report.replay import replay

pytestmark = pytest.mark.slow


def test_the_moving_picture_shows_a_part_that_the_table_locates(table, job):
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
