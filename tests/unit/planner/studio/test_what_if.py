"""What is tried beside a plan: values that grow or shrink, until one is too much."""

import json

from planner.studio.what_if import trials_of

JOB = """
[uncertainty]
radius_mm = 10.0
[goal]
distance_mm = 3.0
confidence = 0.95
"""


def test_a_value_is_too_much_where_fewer_parts_are_located_than_asked_for(tmp_path):
    job = tmp_path / "a.toml"
    job.write_text(JOB)
    trial = next(trials_of(job))
    for row, enough in (
        ({"success_rate": 0.96}, True),
        ({"success_rate": 0.94}, False),
        ({"error": "fingers come down on the part"}, False),
    ):
        (tmp_path / "summary.json").write_text(json.dumps([row]))
        assert trial.result(20.0, tmp_path / "summary.json")["enough"] == enough
