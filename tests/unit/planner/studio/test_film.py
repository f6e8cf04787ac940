"""The film of a simulated part: the world prints each squeeze as JSON, the film adds hand and outline."""

import json

import pytest
from rectangle import JOB_PATH

from planner.job.model import load
from planner.studio.film import film, make
from planner.world import ContactWorld
from runtime.shell.errors import UsageError

SQUEEZED = {"before": {"x_mm": 1.0}, "after": {"x_mm": 0.0}, "width_mm": 21.0}


def test_filmed_squeeze_equals_that_of_the_world_and_is_printed(capfd):
    job = load(JOB_PATH)
    pose = (1.0, 2.0, 0.1)
    final, width_mm, status = make(job, 3).squeeze(pose)
    assert (final, width_mm, status) == ContactWorld(job, 3).squeeze(pose)
    squeezed = json.loads(capfd.readouterr().out)["squeezed"]
    assert squeezed["before"] == {"x_mm": 1.0, "y_mm": 2.0, "turn_deg": 5.73}
    assert squeezed["width_mm"] == width_mm
    assert squeezed["after"]["x_mm"] == round(final[0], 3)


def test_film_places_the_hand_by_the_table(table):
    path = [0, table.nodes[0].branches[0].target]
    part = {"number": 7, "path": path, "squeezes": [SQUEEZED, SQUEEZED]}
    shown = film(table, [part], "7")
    assert len(shown["squeezes"]) == 2
    for node, squeeze in zip(path, shown["squeezes"], strict=True):
        stated = table.nodes[node].squeeze
        assert squeeze["hand"]["x_mm"] == pytest.approx(stated.x_um / 1000, abs=1e-3)
        assert squeeze["opening_mm"] == stated.opening_um / 1000
        assert squeeze["width_mm"] == 21.0
    assert len(shown["outline"]) == 4
    assert shown["reach_mm"] > 15.0
    json.dumps(shown)


@pytest.mark.parametrize("number", ["8", "", "<b>"])
def test_film_part_that_is_not_in_the_log_is_refused(table, number):
    with pytest.raises(UsageError, match="not in the log"):
        film(table, [{"number": 7, "path": [0], "squeezes": []}], number)
