"""The live page: parsing of its address, answers to requests, and the table that the page holds."""

import json
import re
from collections.abc import Callable
from functools import partial

import pytest
from html_pages import Page
from sample_tables import every_field_table, small_table, with_job

from runtime.monitoring.live import page, server
from runtime.monitoring.live.server import Address, answer
from runtime.shell.errors import UsageError

PAGES = {"/": ("text/html", lambda: b"<p>"), "/status.json": ("application/json", lambda: b"{}\n")}
LOCAL = partial(answer, PAGES, local=True)
OPEN = partial(answer, PAGES, local=False)


def output(answers: Callable[[bytes], bytes], asked: str) -> tuple[int, str, bytes]:
    """Status code, head and body of the answer to the request `asked`."""
    head, _, body = answers(asked.encode("latin-1")).partition(b"\r\n\r\n")
    return int(head.split()[1]), head.decode(), body


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("8080", Address("127.0.0.1", 8080)),
        ("0.0.0.0:65535", Address("0.0.0.0", 65535)),
        ("cell-3.local:80", Address("cell-3.local", 80)),
        ("[::1]:8080", Address("::1", 8080)),
    ],
)
def test_parse_port_or_host_and_port_gives_address(text, address):
    assert server.parse(text) == server.parse(str(address)) == address


BAD = ["", "x", "-1", "65536", "9" * 5000, "80.5", ":80", "::1:80", "[1]:80", "a b:80", "h/:80"]


@pytest.mark.parametrize("text", [*BAD, "\u0668\u0660"])
def test_parse_invalid_address_is_refused(text):
    with pytest.raises(UsageError, match="write PORT or HOST:PORT"):
        server.parse(text)


def test_answer_get_has_length_and_forbids_caching_and_framing():
    asked = "GET /status.json?x=1 HTTP/1.1\r\nHost: localhost:8080\r\n\r\n"
    code, head, body = output(LOCAL, asked)
    assert (code, body) == (200, b"{}\n")
    assert "Content-Length: 3\r\n" in head
    guards = {"Cache-Control: no-store", "X-Content-Type-Options: nosniff", "X-Frame-Options: DENY"}
    assert guards <= {*head.split("\r\n")}


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "CONNECT"])
def test_answer_modifying_method_is_405(method):
    code, head, _ = output(OPEN, f"{method} / HTTP/1.1\r\nHost: x\r\n\r\n")
    assert code == 405
    assert "Allow: GET, HEAD" in head


@pytest.mark.parametrize(
    "line", ["", "GET", "GET /", "get / HTTP/1.1", "GET x HTTP/1.1", "GET / HTTP/2", "\x00\xff"]
)
def test_answer_malformed_request_is_400(line):
    assert output(OPEN, f"{line}\r\n\r\n")[0] == 400


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ("", 200),
        ("Host: localhost\r\n", 200),
        ("HOST:127.0.0.1:8080\r\n", 200),
        ("Accept: */*\r\nhost:\t[::1]:8080 \r\n", 200),
        ("Host: evil.example\r\n", 403),
        ("Host: localhost.evil.example:8080\r\n", 403),
        ("Host: localhost\r\nHost: evil.example\r\n", 403),
        ("Host:\r\n", 403),
        ("Host: evil.example other\r\n", 403),
        ("Host: \x80\r\n", 403),
        ("Host : evil.example\r\n", 403),
    ],
)
def test_answer_local_page_with_foreign_host_is_403(fields, code):
    assert output(LOCAL, f"GET / HTTP/1.1\r\n{fields}\r\n")[0] == code
    assert output(OPEN, f"GET / HTTP/1.1\r\n{fields}\r\n")[0] == 200


def test_page_holds_table_and_loads_nothing_external():
    table = every_field_table()
    text = page.page(table, "small.msgpack")
    read = Page(text)
    data = json.loads(read.scripts["data"])
    nodes, branches, leaves = data["nodes"], data["branches"], data["leaves"]
    assert nodes["x_um"] == [node.squeeze.x_um for node in table.nodes]
    assert nodes["force_mn"] == [node.squeeze.force_mn for node in table.nodes]
    every = [(k, branch) for k, node in enumerate(table.nodes) for branch in node.branches]
    assert branches["node"] == [node for node, _ in every]
    assert branches["target"] == [branch.target for _, branch in every]
    assert branches["low_um"] == [branch.low_um for _, branch in every]
    assert leaves["theta_urad"] == [leaf.theta_urad for leaf in table.leaves]
    assert leaves["resolved"] == [int(leaf.resolved) for leaf in table.leaves]
    assert not read.open
    loaded = [attributes for tag, attributes in read.elements if tag in ("link", "script", "img")]
    assert not [each for each in loaded if "//" in str(each)]
    assert re.findall(r"@import|url\(|https?://(?!www\.w3\.org/2000/svg)", text) == []
    assert "default-src 'none'" in text
    assert "connect-src 'self'" in text


def test_page_of_several_parts_has_names_and_outlines():
    table = every_field_table()
    outlines = [[[0, 0], [10 + k, 0], [0, 5.5]] for k, _ in enumerate(table.hypotheses)]
    listed = [{"part": {"name": f"<{k}>", "outline_mm": o}} for k, o in enumerate(outlines)]
    text = page.page(with_job(table, json.dumps({"hypothesis": listed})), "several")
    data = json.loads(Page(text).scripts["data"])
    assert data["outlines"] == outlines
    assert data["names"] == [part.name for part in table.hypotheses]
    assert data["leaves"]["hypothesis"] == [leaf.hypothesis for leaf in table.leaves]
    assert f"<h1>{' or '.join(f'&lt;{k}&gt;' for k, _ in enumerate(outlines))}" in text


def test_page_part_is_drawn_and_html_in_its_name_escaped():
    evil = '</script><img src=x onerror="alert(1)">$name'
    job = json.dumps({"part": {"name": evil, "outline_mm": [[0, 0], [10, 0], [0, 5.5]]}})
    read = Page(page.page(with_job(small_table(), job), evil))
    assert json.loads(read.scripts["data"])["outlines"] == [[[0, 0], [10, 0], [0, 5.5]]]
    assert not [tag for tag, _ in read.elements if tag == "img"]
    assert len([tag for tag, _ in read.elements if tag == "script"]) == 2


@pytest.mark.parametrize("job", [None, "{}", '{"part": 3}', '{"part": {"outline_mm": [[1]]}}'])
def test_page_of_unreadable_job_has_no_outline(job):
    table = small_table() if job is None else with_job(small_table(), job)
    assert json.loads(Page(page.page(table, "t")).scripts["data"])["outlines"] == []
