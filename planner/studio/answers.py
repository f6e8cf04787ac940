"""Responses of the studio: its page, the state and files of its folder, and requested actions.

Other programs may write in the folder, so a browser opens its files in a sandbox.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

from planner.job.drafts import FINGERS, GRIPPERS, opening_of
from planner.part.importers.file import SUFFIXES
from planner.part.importers.pieces import UNITS_MM
from planner.studio.film import film
from planner.studio.folder import Folder
from planner.studio.plans import Plan, Plans
from planner.studio.reader import Reader
from planner.studio.steps import PICTURE, beginning, typed
from planner.templating import environment
from runtime.pages.frame import asset
from runtime.shell.errors import UsageError
from runtime.table import loads

MOST_FILE_BYTES = 256 << 20
PAGE = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
SANDBOX = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:"
)
KINDS = {
    ".html": "text/html",
    ".svg": "image/svg+xml",
    ".js": "text/javascript",
    ".css": "text/css",
}
JSON = "application/json"
TEXT = ("text/plain; charset=utf-8", (".toml", ".jsonl", ".csv", ".txt"))


class Answer(NamedTuple):
    """An HTTP response: its body, content type, security policy and status code."""

    body: bytes
    kind: str = JSON
    policy: str = SANDBOX
    code: int = 200
    name: str = ""  # suggested name of a file that a browser saves


class Answers:
    """Answers requests about one folder."""

    def __init__(self, folder: Folder) -> None:
        self.folder, self.plans, self.reader = folder, Plans(folder), Reader(folder.path)

    def page(self) -> Answer:
        """The page, which requests the state of the folder."""
        template = environment("planner.studio", markup=True).get_template("studio.html")
        text = template.render(
            folder=self.folder.path.name or "/",
            suffixes=SUFFIXES,
            unit_options=[(unit, unit) for unit in UNITS_MM],
            gripper_options=[(name, f"{name}, {opening_of(name):g} mm") for name in GRIPPERS],
            finger_options=[
                (name, f"{pads.material}, {pads.low:g} to {pads.high:g}")
                for name, pads in FINGERS.items()
            ],
        )
        return Answer(text.encode(errors="replace"), "text/html; charset=utf-8", PAGE)

    def static(self, name: str) -> Answer:
        """A stylesheet or script of the studio, or `elements.js`, which the reports use, too."""
        kind = f"{KINDS[Path(name).suffix]}; charset=utf-8"
        if name == "elements.js":
            return Answer(asset(name).encode(), kind, PAGE)
        path = Path(__file__).parent / "templates" / name
        shared = asset("style.css") if name == "studio.css" else ""
        text = shared + path.read_text("utf-8")
        return Answer(text.encode(), kind, PAGE)

    def state(self) -> Answer:
        """The drawings, plans and files of the folder."""
        files = self.folder.files()
        drawn = [file.name for file in files if file.name.lower().endswith(SUFFIXES)]
        drawings = [name for name in drawn if not name.endswith(PICTURE)]
        plans = [_shown(plan) for plan in self.plans.all()]
        listed = [file._asdict() for file in files]
        return _object({"drawings": drawings, "plans": plans, "files": listed})

    def file(self, name: str) -> Answer:
        """A file of the folder: text, pages and SVG for the browser to show, others to save."""
        data, suffix = self.folder.read(name, MOST_FILE_BYTES), Path(name).suffix
        if suffix in TEXT[1]:
            return Answer(data, TEXT[0])
        if suffix in (".html", ".svg"):
            return Answer(data, KINDS[suffix])
        return Answer(data, "application/octet-stream", name=name)

    def film(self, query: dict[str, str]) -> Answer:
        """The squeezes of a simulated part; `query` names the plan and the number of the part."""
        named = query.get("plan", "")
        plan = next((plan for plan in self.plans.all() if plan.name == named), None)
        if plan is None or "table" not in plan.files:
            raise UsageError(f"{named}: there is no such plan with a table")
        table = loads(self.folder.read(plan.files["table"], MOST_FILE_BYTES))
        return _object(film(table, plan.log.parts, query.get("part", "")))

    def add(self, query: dict[str, str], body: bytes) -> Answer:
        """Stores a drawing under the name in `query`; adds a number to the name if it is taken."""
        return _object({"drawing": self.folder.add(query.get("name", ""), body)})

    def preview(self, query: dict[str, str], body: bytes) -> Answer:
        """The preview of the drawing that `query` names with the settings in `body`.

        Also states the command line that a user would type to plan with these settings.
        """
        drawing = query.get("drawing", "")
        arguments = self.plans.arguments(drawing, _settings(body))
        command = typed(["try", beginning(drawing), *arguments])
        return _object({**self.reader.ask([beginning(drawing), *arguments]), "command": command})

    def plan(self, query: dict[str, str], body: bytes) -> Answer:
        """Starts planning the drawing that `query` names with the settings in `body`.

        Refuses a drawing whose preview fails.
        """
        drawing = query.get("drawing", "")
        arguments = self.plans.arguments(drawing, _settings(body))
        refused = self.reader.ask([beginning(drawing), *arguments])["error"]
        if refused:
            raise UsageError(refused)
        return _object({"plan": self.plans.begin(drawing, arguments)})

    def stop(self, query: dict[str, str], _body: bytes) -> Answer:
        """Asks the plan that `query` names to end with the result so far."""
        self.plans.stop(query.get("plan", ""))
        return _object({})


def _shown(plan: Plan) -> dict[str, Any]:
    return {**plan._asdict(), "log": plan.log._asdict()}


def _settings(body: bytes) -> dict[str, Any]:
    try:
        settings = json.loads(body)
    except (ValueError, RecursionError):
        settings = None
    if not isinstance(settings, dict):
        raise UsageError("settings are a JSON object")
    return settings


def _object(values: dict[str, Any], code: int = 200) -> Answer:
    return Answer(json.dumps(values).encode(), code=code)


def refused(code: int, reason: str) -> Answer:
    """The response that refuses a request, with the reason."""
    return _object({"error": reason}, code)
