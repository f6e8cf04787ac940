"""Runs the scripts of pages in Chromium without a network, and returns what the pages contain afterwards."""

import json
import re
import shutil
from html import escape, unescape
from pathlib import Path
from typing import Any

import pytest
from programs import ROOT, ended

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
QUIET = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"),
    *("--virtual-time-budget=2000", "--host-resolver-rules=MAP * ~NOTFOUND"),
]
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
# Script for `played`: returns the texts that are too small to read, and the page's excess width [px].
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
NEEDED = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (Debian: chromium)")


def page_after(page: str, folder: Path) -> str:
    """Opens a page in Chromium; returns its HTML after its scripts have run."""
    file = folder / "page.html"
    file.write_text(page, "utf-8")
    words = [str(CHROMIUM), *QUIET, f"--user-data-dir={folder / 'profile'}", "--dump-dom"]
    code, out, err = ended([*words, file.as_uri()])
    assert code == 0, err
    return out


def value_of(expression: str, scripts: list[str], folder: Path) -> object:
    """Runs scripts of the project in Chromium, and returns the value of a JavaScript expression after them.

    `scripts` are paths from the root of the project. The value must be one that JSON can represent.
    """
    modules = [(ROOT / name).read_text("utf-8") for name in scripts]
    text = re.sub(r"^import .*$|^export ", "", "\n".join(modules), flags=re.MULTILINE)
    shown = "document.getElementById('result').textContent"
    report = f"try {{ {shown} = JSON.stringify({expression}) }} catch (error) {{ {shown} = String(error) }}"
    html = f'<svg id="view"></svg><pre id="result"></pre><script>{text}\n{report}</script>'
    result = re.search(r'<pre id="result">(.*?)</pre>', page_after(html, folder), re.DOTALL)
    assert result is not None
    return json.loads(unescape(result[1]))


def played(page: str, script: str, folder: Path, width: int = 1400) -> Any:
    """Runs a script on a page that is `width` pixels wide; returns the result of the script.

    In the script, `page` is the document and `view` the window.
    """
    harness = HARNESS.format(width=width, page=escape(page), script=script)
    after = page_after(harness, folder).rpartition('<pre id="said">')[2].partition("</pre>")[0]
    result = json.loads(unescape(after))
    assert result["errors"] == []
    return result["seen"]
