"""The live page's script in Chromium: the tree is drawn from the table, and a lost cell is told."""

import re

import pytest
from browser import NEEDED, page_after
from sample_tables import small_table

from runtime.monitoring.live import page

pytestmark = [NEEDED, pytest.mark.slow]


def test_the_tree_has_each_node_and_leaf_and_the_page_says_that_nobody_answers(tmp_path):
    after = page_after(page.page(small_table(), '<b>"ä".msgpack'), tmp_path)
    panels = re.findall(r'<g class="panel (\w+)[^"]*" id="([\w-]+)"', after)
    kinds = {name: kind for kind, name in panels}
    assert kinds == {
        "node-0": "node",
        "node-1": "node",
        "leaf-0": "leaf",
        "leaf-1": "leaf",
        "leaf-2": "unresolved",
    }
    assert 'aria-label="Leaf 0: part at 0.0, 0.5 mm, 0 degrees"' in after
    assert "20.0\N{EN DASH}22.0" in after
    assert "The cell does not answer" in after
    assert "&lt;b&gt;" in after
