"""What-if trials: values of a job that grow or shrink until the plan for one of them fails."""

import json

from planner.studio.what_if import trials_of

JOB = """
[uncertainty]
radius_mm = 10.0
[goal]
distance_mm = 3.0
confidence = 0.95
"""


def test_result_is_enough_where_the_confidence_is_reached(tmp_path):
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
