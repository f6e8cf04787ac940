"""The live page's script in Chromium: it draws the tree of the table and reports a cell that is silent."""

import re

import pytest
from browser import LEGIBLE, NEEDED, page_after, played
from sample_tables import small_table

from runtime.monitoring.live import page

pytestmark = [NEEDED, pytest.mark.slow]


def test_script_draws_every_node_and_leaf_and_reports_silent_cell(tmp_path):
    after = page_after(page.page(small_table(), '<b>"ä".msgpack'), tmp_path)
    panels = re.findall(r'class="panel (\w+)[^"]*" id="([\w-]+)"', after)
    kinds = {name: kind for kind, name in panels}
    leaves = {"leaf-0": "leaf", "leaf-1": "leaf", "leaf-2": "unresolved"}
    assert kinds == {"node-0": "node", "node-1": "node", **leaves}
    assert 'aria-label="Leaf 0: 0.0, 0.5 mm, 0°"' in after
    assert "20.0\N{EN DASH}22.0" in after
    assert "The cell does not answer" in after
    assert "&lt;b&gt;" in after


def test_script_arrow_keys_move_along_branches_and_stop_following(tmp_path):
    script = """
  byId("tree").open = true;
  byId("node-0").click();
  const seen = {follow: byId("follow").checked, at: []};
  for (const key of ["ArrowRight", "ArrowLeft", "ArrowDown", "ArrowDown", "Home"]) {
    press(key);
    seen.at.push(page.activeElement.id);
  }
  seen.said = byId("details").querySelector("h3").textContent;
  return seen;
"""
    seen = played(page.page(small_table(), "small.msgpack"), script, tmp_path)
    target = small_table().nodes[0].branches[0].target
    first = f"node-{target}" if target >= 0 else f"leaf-{~target}"
    assert (seen["follow"], seen["said"]) == (False, "Node 0")
    assert seen["at"][:2] == [first, "node-0"]
    assert len({*seen["at"][1:4]}) == 3
    assert seen["at"][4] == "node-0"


@pytest.mark.parametrize("width", [1400, 390])
def test_page_is_legible_and_no_wider_than_screen(tmp_path, width):
    seen = played(page.page(small_table(), "small.msgpack"), LEGIBLE, tmp_path, width)
    assert seen == {"small": [], "over": 0}
