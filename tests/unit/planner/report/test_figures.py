"""The pictures of the documentation: they show what is kept, no text covers another, files are small."""

import itertools
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import charts
import movie
import pytest
import single_squeezes
from comparison import table_rows
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from planner.job import model as job_file
from planner.report import canvas
from planner.report.replay import replay
from runtime.table import load

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[4]
TREES = ROOT / "trees"
RESULTS = ROOT / "tests" / "bench" / "results"
RADII = {row.part: 10.0 for row in table_rows(TREES)}


@pytest.fixture(scope="module")
def planned():
    job = job_file.load(TREES / "rectangle" / "job.toml")
    table = load(TREES / "rectangle" / "rectangle.msgpack").table
    return table, job, replay(table, job, 2000, 0)


def kept(name):
    return json.loads((RESULTS / f"{name}.json").read_text())


def words(figure):
    """Each text that is seen, with its box in pixels."""
    FigureCanvasAgg(figure).draw()
    renderer = figure.canvas.get_renderer()
    seen = [text for text in figure.findobj(Text) if text.get_text().strip() and text.get_visible()]
    size = figure.bbox
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in seen]
    ticks = {
        label.get_text()
        for axes in figure.axes
        for label in axes.get_xticklabels() + axes.get_yticklabels()
    }
    return [
        (text, box) for text, box in boxes if size.overlaps(box) or text not in ticks
    ]  # of those drawn


def assert_legible(figure):
    result = words(figure)
    for text, box in result:
        assert min(box.x0, box.y0) >= -1, text
        assert max(box.x1 - figure.bbox.x1, box.y1 - figure.bbox.y1) <= 1, text
    for (one, a), (other, b) in itertools.combinations(result, 2):
        across = min(a.x1, b.x1) - max(a.x0, b.x0)
        down = min(a.y1, b.y1) - max(a.y0, b.y0)
        assert across <= 1.0 or down <= 2.0, f"{one!r} covers {other!r}"


def test_table_one_shows_the_kept_rates_and_the_papers():
    rows = kept("table1")["rows"]
    with canvas.style():
        figure = charts.table_one(rows, RADII)
        assert_legible(figure)
    heights = [
        [bar.get_height() for bar in bars]
        for bars in figure.axes[0].containers
        if hasattr(bars, "patches")
    ]
    experiments = list(dict.fromkeys(row["row"] for row in rows))
    assert heights[0] == pytest.approx([100 * row.paper for row in table_rows(TREES)])
    ours = {row["row"]: 100 * row["within_rate"] for row in rows if row["method"] == "closed-loop"}
    assert heights[1] == pytest.approx([ours[name] for name in experiments])


def test_the_partition_has_the_papers_four_subspaces():
    job = job_file.load(TREES / "rectangle" / "job.toml")
    with canvas.style():
        figure = single_squeezes.partition(job, ("free space", "long", "short", "diagonal"))
        assert_legible(figure)
    shares = [int(re.search(r"(\d+) % of", axes.get_title())[1]) for axes in figure.axes]
    assert sum(shares) == pytest.approx(100, abs=2)
    with pytest.raises(ValueError, match="4 subspaces"):
        single_squeezes.partition(job, ("one", "two"))


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
