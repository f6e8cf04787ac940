"""The times of a journal's parts by phase, and the entries that are refused."""

import pytest

from runtime.journal.times import times_of
from runtime.table import Phases

ONE = dict(zip(Phases._fields, (0.0, 1.0, 0.25, 0.5, 0.125, 0.125), strict=True))


def outcome(seconds: object, *phases: object) -> dict[str, object]:
    return {"kind": "outcome", "seconds": seconds, "phases": list(phases)}


def test_times_of_sums_parts_by_phase():
    entries = [{"kind": "part"}, outcome(4.5, ONE, ONE), outcome(2.0, ONE), outcome(None)]
    result = times_of(entries, takt_s=3.0)
    assert (result.parts, result.squeezes) == (2, 3)
    assert result.phases["travel"] == 1.5
    assert sum(result.phases.values()) == pytest.approx(result.figures["seconds_mean"])
    assert result.figures["takt_probability"] == 0.5


@pytest.mark.parametrize(
    "entry",
    [
        outcome("long", ONE),
        outcome(-1.0, ONE),
        outcome(float("nan"), ONE),
        outcome(True, ONE),
        outcome(1.0, {"travel_s": 1.0}),
        outcome(1.0, 5),
        outcome(1.0, ONE | {"close_s": "x"}),
        {"kind": "outcome", "seconds": 1.0},
    ],
)
def test_times_of_invalid_entry_is_refused(entry):
    with pytest.raises(ValueError, match=r"phases|no time"):
        times_of([entry])
