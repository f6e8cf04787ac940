"""The pictures of the documentation: they show what is kept, no text covers another, files are small."""

import re
from pathlib import Path
from xml.etree import ElementTree

import movie
import pytest

from planner.job import model as job_file
from planner.report.replay import replay
from runtime.table import load

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[4]
TREES = ROOT / "trees"


@pytest.fixture(scope="module")
def planned():
    job = job_file.load(TREES / "rectangle" / "job.toml")
    table = load(TREES / "rectangle" / "rectangle.msgpack").table
    return table, job, replay(table, job, 2000, 0)


def test_the_moving_picture_shows_a_part_that_the_table_locates(planned):
    table, job, beliefs = planned
    drawn = ElementTree.fromstring(movie.picture(table, job, beliefs))
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
