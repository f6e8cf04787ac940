"""A table of the rectangle by widths decides at each count of a 2F-85 as its table of counts did.

`rectangle-counts.json` has a row for each node: object flag (2 felt, 3 not), first and last count, target;
all other counts were rejected. It was exported from the table when branches were looked up by counts.
"""

import json
from pathlib import Path

from runtime.table import Calibration, decide, decision_map, load

FOLDER = Path(__file__).parent
FORMER = json.loads((FOLDER / "rectangle-counts.json").read_text())
TABLE = load(FOLDER / "rectangle-widths.msgpack").table


def test_rectangle_table_at_every_count_and_flag_decides_as_before() -> None:
    profile = TABLE.gripper.profile
    calibration = Calibration(profile)
    assert len(FORMER) == len(TABLE.nodes)
    for node, runs in zip(TABLE.nodes, FORMER, strict=True):
        decided = decision_map(node, TABLE.gripper)
        for flag in (2, 3):
            for count in range(256):
                branch = decide(decided, calibration.width_um(profile.counted_um(count)), flag == 2)
                target = None if branch < 0 else node.branches[branch].target
                ranges = [run for run in runs if run[0] == flag and run[1] <= count <= run[2]]
                assert [target] == ([run[3] for run in ranges] or [None])
