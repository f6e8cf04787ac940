"""The arc of the finger tips: the published heights, and closings in several strokes that keep the height."""

from itertools import product

import pytest
from sample_tables import changed, small_table

from runtime.commands.arguments import parser
from runtime.commands.options import run_options
from runtime.execution.tips import TipArc
from runtime.shell.errors import UsageError

ARC = TipArc()
# Tip height over opening relative to closed fingers, from the link geometry of the published URDF models.
PUBLISHED = {5: 0.16, 10: 0.22, 20: 0.0, 30: -0.66, 40: -1.78}
PUBLISHED |= {50: -3.39, 60: -5.54, 70: -8.29, 80: -11.75, 85: -13.8}


@pytest.mark.parametrize(("width_mm", "height_mm"), PUBLISHED.items())
def test_tip_arc_advance_equals_published_heights(width_mm, height_mm):
    assert ARC.advance_mm(width_mm) - ARC.advance_mm(0.0) == pytest.approx(height_mm, abs=0.006)


def test_tip_arc_advance_is_zero_at_taught_width():
    assert ARC.advance_mm(85.0) == 0.0
    assert TipArc(taught_mm=50.0).advance_mm(50.0) == 0.0
    assert ARC.advance_mm(10.0) == max(ARC.advance_mm(width / 10) for width in range(851))


WIDEST_MM, LEAST_MM = (85.0, 60.0, 33.0, 12.0, 8.0), (0.0, 5.0, 21.0)
CLOSINGS = [(widest, least) for widest, least in product(WIDEST_MM, LEAST_MM) if least < widest]


@pytest.mark.parametrize(("widest_mm", "least_mm"), CLOSINGS)
@pytest.mark.parametrize("level_mm", [0.5, 2.0, 8.0])
def test_tip_arc_stages_keep_tips_within_level(widest_mm, least_mm, level_mm):
    arc = TipArc(level_mm=level_mm)
    start_mm = widest_mm
    stages = arc.stages(widest_mm, least_mm)
    assert stages[-1] == least_mm
    for end_mm in stages:
        assert end_mm < start_mm
        raised_mm = arc.most_mm(end_mm, start_mm)  # where the arm stands during the stage
        widths = (end_mm + (start_mm - end_mm) * k / 50 for k in range(51))
        heights = [raised_mm - arc.advance_mm(width) for width in widths]  # above the intended one
        assert min(heights) >= -1e-9
        # Below the arc's top the tips draw back by a quarter of a millimetre, in one go.
        assert max(heights) <= max(level_mm, 0.25) + 1e-9
        start_mm = end_mm


@pytest.mark.parametrize(
    ("model", "named", "arc"),
    [
        ("robotiq-2f-85", None, (57.15, 5.0)),
        ("robotiq-2f-140", "100,5.4", (100.0, 5.4)),
        ("robotiq-2f-140", "straight", None),
        ("hand-e", None, None),
    ],
)
def test_tip_arc_follows_from_model_and_option(model, named, arc):
    result = arc_of(model, named)
    assert result == arc if result is None else (result.link_mm, result.offset_mm) == arc


@pytest.mark.parametrize("named", [None, "arc"])
def test_tip_arc_of_unknown_offset_is_refused(named):
    with pytest.raises(UsageError, match=r"2f-140 .* measured: write --tips 100,OFFSET"):
        arc_of("robotiq-2f-140", named)


def arc_of(model: str, named: str | None) -> TipArc | None:
    table = changed(small_table(), {"gripper.model": model})
    words = ["--tree", "T", "--port", "P", "--deliver", "no", *(["--tips", named] if named else [])]
    return run_options(parser().parse_args(words), table, None).handling.arc
