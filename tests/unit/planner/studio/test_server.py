"""The studio over HTTP: which requests are answered, which files are reached, and how they are shown."""

import http.client
import json
import re
import socket
import struct
import threading
from types import SimpleNamespace
from urllib.parse import quote

import pytest
from html_pages import Page

from planner.studio.answers import Answer
from planner.studio.folder import Folder
from planner.studio.server import Studio

NAME = "<b>'\"& ä.csv"


@pytest.fixture
def studio(tmp_path, monkeypatch):
    (tmp_path / "secret").write_text("secret")
    work = tmp_path / "<i>work"
    work.mkdir()
    (work / NAME).write_text("0,0\n1,0\n0,1\n")
    (work / "report.html").write_text("<script>1</script>")
    (work / "plate.look.svg").write_text("<svg/>")
    asked = []
    reader = SimpleNamespace(ask=lambda words: asked.append(words) or {"error": None}, close=int)
    with Studio(Folder(work), 0) as server:
        server.answers.reader, server.folder, server.asked = reader, server.answers.folder, asked
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def call(studio, method, path, body=None, **headers):
    host = f"127.0.0.1:{studio.server_port}"
    usual = {"Host": host, **({"Origin": f"http://{host}"} if method == "POST" else {})}
    chosen = {key: value for key, value in {**usual, **headers}.items() if value is not None}
    connection = http.client.HTTPConnection("127.0.0.1", studio.server_port, timeout=60)
    connection.putrequest(method, path, skip_host=True)
    if body is not None:
        chosen.setdefault("Content-Length", str(len(body)))
    for key, value in chosen.items():
        connection.putheader(key, value)
    connection.endheaders(body)
    response = connection.getresponse()
    data = response.read()
    connection.close()
    return response, data


def test_get_page_is_well_formed_labelled_and_self_contained(studio):
    response, data = call(studio, "GET", "/")
    text = data.decode()
    page = Page(text)
    assert page.open == []
    labelled = {attributes["for"] for tag, attributes in page.elements if tag == "label"}
    fields = {attributes["id"] for tag, attributes in page.elements if tag in ("input", "select")}
    assert fields == labelled
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert "default-src 'none'" in response.getheader("Content-Security-Policy")
    assert "unsafe" not in response.getheader("Content-Security-Policy")
    assert "&lt;i&gt;work" in text
    assert not re.search(r"https?:|style=|<script>| on\w+=", text)


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:1", None]
)
def test_get_for_another_host_is_forbidden(studio, host):
    for path in ("/", "/folder.json", "/files/report.html"):
        response, data = call(studio, "GET", path, Host=host)
        assert response.status == 403
        assert b"report" not in data


@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "http://127.0.0.1:1"])
@pytest.mark.parametrize(
    "path", ["/plan?drawing=x", "/stop?plan=x", "/drawings?name=x.csv", "/preview"]
)
def test_post_from_another_origin_is_forbidden(studio, origin, path):
    assert call(studio, "POST", path, b"{}", Origin=origin)[0].status == 403
    assert studio.asked == []


@pytest.mark.parametrize("path", ["../secret", "..%2Fsecret", "%2e%2e%2fsecret", "a%00b"])
def test_get_file_outside_the_folder_is_refused(studio, path):
    response, data = call(studio, "GET", f"/files/{path}")
    assert response.status == 400
    assert data.count(b"\n") == 0
    assert b"secret" not in data.replace(b"../secret", b"")


def test_post_drawing_is_stored_and_a_path_as_its_name_is_refused(studio):
    answer = json.loads(call(studio, "POST", "/drawings?name=new.csv", b"0,0\n")[1])
    assert answer == {"drawing": "new.csv"}
    response, data = call(studio, "POST", "/drawings?name=..%2Fnew.csv", b"0,0\n")
    assert (response.status, "no slashes" in json.loads(data)["error"]) == (400, True)


@pytest.mark.parametrize("length", ["99999999999", "9" * 5000, "-1", "x", ""])
def test_post_of_invalid_or_huge_length_is_refused(studio, length):
    response, _ = call(studio, "POST", "/drawings?name=a.csv", b"", **{"Content-Length": length})
    assert response.status == 413


def test_get_of_an_address_that_is_none_is_answered(studio, capsys):
    response, _ = call(studio, "GET", "http://[")
    assert response.status == 404
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b'{"output": "x"}', b"\xff", b"[" * 10_000])
def test_post_plan_with_invalid_settings_is_refused(studio, body):
    response, data = call(studio, "POST", f"/plan?drawing={quote(NAME)}", body)
    assert response.status == 400
    assert json.loads(data)["error"]


def test_post_preview_returns_the_equivalent_command(studio):
    body = b'{"radius": "5"}'
    answer = json.loads(call(studio, "POST", f"/preview?drawing={quote(NAME)}", body)[1])
    assert studio.asked == [[NAME, "--radius=5"]]
    assert answer["command"].endswith("--radius 5")


def test_get_files_are_sandboxed_or_shown_as_text_or_saved(studio):
    report, _ = call(studio, "GET", "/files/report.html")
    assert report.getheader("Content-Security-Policy").startswith("sandbox allow-scripts;")
    assert "allow-same-origin" not in report.getheader("Content-Security-Policy")
    table, data = call(studio, "GET", f"/files/{quote(NAME)}")
    assert table.getheader("Content-Type").startswith("text/plain")
    assert data.startswith(b"0,0")
    (studio.folder.path / "a.msgpack").write_bytes(b"x")
    saved = call(studio, "GET", "/files/a.msgpack")[0].getheader("Content-Disposition")
    assert saved == "attachment; filename*=UTF-8''a.msgpack"


def test_get_from_a_tab_closed_before_its_answer_prints_nothing(studio, capsys):
    asked, gone = threading.Event(), threading.Event()

    def state():
        asked.set()
        gone.wait(60)
        return Answer(bytes(8 << 20))

    studio.answers.state = state
    handled = studio.shutdown_request
    ended = threading.Event()
    studio.shutdown_request = lambda request: (handled(request), ended.set())
    with socket.create_connection(("127.0.0.1", studio.server_port)) as tab:
        reset_when_closed = struct.pack("ii", 1, 0)
        tab.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, reset_when_closed)
        host = f"127.0.0.1:{studio.server_port}"
        tab.sendall(f"GET /folder.json HTTP/1.0\r\nHost: {host}\r\n\r\n".encode())
        assert asked.wait(60)
    gone.set()
    assert ended.wait(60)
    assert capsys.readouterr().err == ""
