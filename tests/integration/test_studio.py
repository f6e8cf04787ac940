"""The studio over HTTP: from a drawing to a table and simulated parts, even if the studio is killed."""

import json
import sys
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from html_pages import Page
from programs import started, until

from runtime.table import load

CODE = "import sys; from planner.cli.studio import main; sys.exit(main(sys.argv[1:]))"
QUICK = {"radius": "2", "turn": "8", "budget": "2", "units": "mm"}


class Studio:
    """A running studio."""

    def __init__(self, folder):
        words = [sys.executable, "-c", CODE, folder, "--port", "0", "--no-browser", "--json"]
        self.process = started(words, stderr=None)
        self.address = json.loads(self.process.stdout.readline())["address"].rstrip("/")

    def ask(self, path, body=None):
        headers = {"Origin": self.address} if body is not None else {}
        with urlopen(Request(self.address + path, body, headers), timeout=120) as response:
            return response.read()

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


def plan_of(studio):
    (plan,) = json.loads(studio.ask("/folder.json"))["plans"]
    return plan


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_studio_killed_while_planning_still_gives_table_and_parts(tmp_path):
    studio = Studio(tmp_path)
    try:
        Page(studio.ask("/").decode())
        assert studio.ask("/drawings?name=plate.csv", b"0,0\n30,0\n30,21\n0,21\n")
        with pytest.raises(HTTPError) as refused:
            studio.ask("/plan?drawing=plate.csv", b'{"radius": "x"}')
        assert "not a number" in json.loads(refused.value.read())["error"]
        name = json.loads(studio.ask("/plan?drawing=plate.csv", json.dumps(QUICK).encode()))["plan"]
        assert name == "plate"
        assert plan_of(studio)["running"]
        studio.kill()
        studio = Studio(tmp_path)
        plan = until(lambda: (each := plan_of(studio)) and not each["running"] and each)
        assert plan["log"]["exit"] == 0, plan["log"]["lines"]
        assert [line.split()[1] for line in plan["log"]["commands"]] == ["try", "report", "run"]
        numbers = plan["log"]["answer"]["numbers"]
        assert [each["what"] for each in numbers] == ["located", "seconds", "error"]
        assert len(plan["log"]["parts"]) == 20
        assert {"job", "table", "picture", "report", "journal", "log"} == plan["files"].keys()
        film = json.loads(studio.ask("/film.json?plan=plate&part=1"))
        widths = [round(squeeze["width_mm"]) for squeeze in film["squeezes"]]
        said = plan["log"]["parts"][0]["widths"].split(",")
        assert widths == [round(float(each)) for each in said]
        table = studio.ask(f"/files/{plan['files']['table']}")
        assert table == (tmp_path / "plate.msgpack").read_bytes()
        assert load(tmp_path / "plate.msgpack").table.nodes
        # No hidden file or draft is left.
        assert {path.name[0] for path in tmp_path.iterdir()} == {"p"}
    finally:
        studio.kill()
        (tmp_path / "plate.stop").touch()
