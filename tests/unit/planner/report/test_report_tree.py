"""The picture of a table as a tree."""

import re
import xml.etree.ElementTree as ET

from planner.job.model import Job
from planner.report import tree
from planner.report.replay import replay
from runtime.table import Table

GROUP = "{http://www.w3.org/2000/svg}g"


def test_picture_has_one_panel_for_each_node_and_leaf(table: Table, job: Job) -> None:
    drawn = ET.fromstring(tree.picture(table, job, replay(table, job, 200, 0)))
    ids = [group.get("id", "") for group in drawn.iter(GROUP)]
    panels = sorted(name for name in ids if re.fullmatch(r"(node|leaf)-\d+", name))
    targets = range(-len(table.leaves), len(table.nodes))
    assert panels == sorted(map(tree.key_of, targets))


def test_percent_share_next_to_none_or_all_is_not_rounded_to_it() -> None:
    shares = (0.0, 0.0002, 0.004, 0.5, 0.9996, 1.0)
    texts = ["0 %", "0.02 %", "0.4 %", "50 %", "99.96 %", "100 %"]
    assert [tree.percent(share) for share in shares] == texts
