"""Plays a page in a headless Chromium: a script in a page around it acts on it and says what it saw."""

import json
import shutil
import subprocess
from html import escape, unescape

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000")
HARNESS = """\
<!DOCTYPE html><meta charset="utf-8"><body style="margin:0">
<iframe id="frame" style="width:{width}px;height:3000px;border:0" srcdoc="{page}"></iframe>
<script>
const errors = [], frame = document.getElementById("frame");
async function play(view, page) {{
  const byId = id => page.getElementById(id);
  const typed = key => new view.KeyboardEvent("keydown", {{key, bubbles: true}});
  const press = key => page.activeElement.dispatchEvent(typed(key));
  const choose = (id, value) => {{
    byId(id).value = value;
    byId(id).dispatchEvent(new view.Event("change"));
  }};
  {script}
}}
frame.addEventListener("load", async () => {{
  frame.contentWindow.addEventListener("error", event => errors.push(event.message));
  let seen = null;
  try {{
    seen = await play(frame.contentWindow, frame.contentDocument);
  }} catch (error) {{
    errors.push(String(error));
  }}
  const said = document.createElement("pre");
  said.id = "said";
  said.textContent = JSON.stringify({{seen, errors}});
  document.body.append(said);
}});
</script>
"""
# Texts that are too small to read, and how much wider than the screen the page is.
LEGIBLE = """
const small = [], walk = page.createTreeWalker(page.body, view.NodeFilter.SHOW_TEXT);
for (const fold of page.querySelectorAll("details")) fold.open = true;
while (walk.nextNode()) {
  const parent = walk.currentNode.parentElement, text = walk.currentNode.data.trim();
  if (!text || parent.closest("script, style, option") || !parent.checkVisibility()) continue;
  const size = parseFloat(view.getComputedStyle(parent).fontSize);
  if (size < 11) small.push([size, text]);
}
return {small, over: page.documentElement.scrollWidth - page.documentElement.clientWidth};
"""


def played(page, script, folder, width=1400):
    """What a script returns that acts on `page` (a document) and its `view` (a window)."""
    path = folder / "harness.html"
    path.write_text(HARNESS.format(width=width, page=escape(page), script=script), "utf-8")
    command = [
        CHROMIUM,
        *FLAGS,
        f"--user-data-dir={folder / 'profile'}",
        "--dump-dom",
        path.as_uri(),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True)
    said = done.stdout.rpartition('<pre id="said">')[2].partition("</pre>")[0]
    result = json.loads(unescape(said))
    assert result["errors"] == []
    return result["seen"]
