"""The frame of all pages: well-formed, loads nothing from a network, and escapes every text."""

import json

from html_pages import Page

from runtime.pages import frame

EVIL = '</script><img src=x onerror="alert(1)">'


def test_page_without_script_forbids_scripts():
    text = frame.page("a < b", "<main></main>")
    assert Page(text).open == []
    assert "default-src 'none'" in text
    assert "script-src" not in text
    assert "<title>a &lt; b</title>" in text


def test_page_data_with_html_cannot_end_its_element():
    page = Page(frame.page(EVIL, "", data={"name": EVIL}, script="let a;\n"))
    assert page.open == []
    assert json.loads(page.scripts["data"]) == {"name": EVIL}
    assert [tag for tag, _ in page.elements if tag in ("script", "img")] == ["script"] * 2
