"""Runs the scripts of pages in Chromium, without a network: what the page holds in the end."""

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
QUIET = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"),
    *("--virtual-time-budget=2000", "--host-resolver-rules=MAP * ~NOTFOUND"),
]
NEEDED = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (Debian: chromium)")


def page_after(page: str, folder: Path) -> str:
    """The HTML of a page once its scripts have run."""
    file = folder / "page.html"
    file.write_text(page, "utf-8")
    words = [str(CHROMIUM), *QUIET, f"--user-data-dir={folder / 'profile'}", "--dump-dom"]
    done = subprocess.run(
        [*words, file.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    return done.stdout


def value_of(expression: str, scripts: list[str], folder: Path) -> object:
    """What a JavaScript expression comes to after some scripts of the project, as JSON holds it."""
    modules = [(ROOT / name).read_text("utf-8") for name in scripts]
    text = re.sub(r"^import .*$|^export ", "", "\n".join(modules), flags=re.MULTILINE)
    shown = "document.getElementById('result').textContent"
    report = f"try {{ {shown} = JSON.stringify({expression}) }} catch (error) {{ {shown} = String(error) }}"
    html = f'<svg id="view"></svg><pre id="result"></pre><script>{text}\n{report}</script>'
    result = re.search(r'<pre id="result">(.*?)</pre>', page_after(html, folder), re.DOTALL)
    assert result is not None
    return json.loads(unescape(result[1]))
