"""Counts of a Robotiq: speed and force never exceed the request, and each count has its own width."""

import pytest

from drivers.errors import PortError
from drivers.ports import GripperProfile
from drivers.robotiq.counts import Counts
from runtime.table import PROFILES

MODELS = [model for model, profile in PROFILES.items() if profile.counts]


@pytest.mark.parametrize("model", MODELS)
def test_counts_setting_is_greatest_not_above_request(model: str) -> None:
    counts, profile = Counts(PROFILES[model]), PROFILES[model]
    for ask, (least, most) in ((counts.speed, profile.speed_mm_s), (counts.force, profile.force_n)):
        step = (most - least) / 255
        for k in range(1000):
            wanted = least + (most - least) * k / 999
            setting = ask(wanted)
            assert least + setting * step <= wanted + 0.001 < least + (setting + 1) * step + 0.002
        assert [ask(value) for value in (0.0, least, most, 1e6)] == [0, 0, 255, 255]


@pytest.mark.parametrize("model", MODELS)
def test_counts_request_of_width_on_grid_is_its_count(model: str) -> None:
    counts, profile = Counts(PROFILES[model]), PROFILES[model]
    first, last = profile.counts
    for count in range(first + 1, last):
        assert counts.request(counts.width_um(count)) == count
        assert counts.target_um(count) == counts.width_um(count)
    assert (counts.request(-1), counts.request(profile.stroke_um)) == (255, 0)
    assert counts.request(0) == last
    assert (counts.target_um(last), counts.target_um(0)) == (0, profile.stroke_um)
    assert counts.target_um(255) == (0 if last == 255 else -1)
    widths = [counts.width_um(count) for count in range(256)]
    assert widths == sorted(set(widths), reverse=True)


def test_counts_of_profile_without_counts_are_refused() -> None:
    with pytest.raises(PortError, match=r"of 8500 steps has no register of counts; .* resolution"):
        Counts(GripperProfile("fine", 85_000, 10.0, 20, (5.0, 50.0), (1.0, 60.0)))
