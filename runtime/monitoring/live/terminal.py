"""The live view in a terminal: what the cell does, its way through the tree, the last parts.

Drawn by a thread of its own from the status. The control loop never writes to the terminal meanwhile: one
that is held (Ctrl-S) or slow delays the picture and nothing else.
"""

import contextlib
import sys
import threading
from collections import deque
from pathlib import Path
from typing import Any, Self, TextIO

from rich.console import Console as Terminal
from rich.console import Group
from rich.live import Live
from rich.text import Text

from runtime.execution.events import Console, Sighting, Tally
from runtime.monitoring.live.rows import Outline, Row
from runtime.monitoring.status import Status
from runtime.shell.plain_text import cleaned
from runtime.spc.drift import REFIT
from runtime.table import Table
from runtime.traversal.results import PartResult, Step

REFRESH_S = 0.125
END_S = 1.0  # how long the end waits for a terminal that takes nothing
MOST_NOTES = 200
PARTS = 5
AROUND = 5 + PARTS  # lines that are not the tree's


class View(Console):
    """A console that draws parts and squeezes as a picture on a terminal; shown within its context.

    The console behind it is told the summary; and squeezes and parts as well if it does not write where the
    picture is.
    """

    def __init__(
        self, table: Table, name: str, status: Status, console: Console, stream: TextIO
    ) -> None:
        self._outline, self._name, self._status, self._console = (
            Outline(table),
            name,
            status,
            console,
        )
        self._terminal = Terminal(file=stream, highlight=False)
        self._beside = stream is not sys.stdout
        self._notes: deque[str] = deque(maxlen=MOST_NOTES)
        self._shown: object = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._show, name="watch", daemon=True)

    def note(self, sentence: str) -> None:
        """Printed above the picture."""
        self._notes.append(cleaned(sentence))

    def step(self, part: int, step: Step) -> None:
        """The status has it."""
        if self._beside:
            self._console.step(part, step)

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """The status has it; where a fault or a stop left the cell is said in full, and stays."""
        if result.safe_state:
            lines = [
                f"part {result.part}: {result.outcome.name}",
                result.reason or "",
                *result.safe_state,
            ]
            self.note("; ".join(filter(None, lines)))
        if self._beside:
            self._console.part(result, seen)

    def summary(self, tally: Tally, journal: Path) -> None:
        """The run's end, below the last picture."""
        self.close()
        self._console.summary(tally, journal)

    def close(self) -> None:
        """Draw once more and give the terminal back."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(END_S)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _show(self) -> None:
        options: dict[str, Any] = {
            "auto_refresh": False,
            "redirect_stdout": False,
            "redirect_stderr": False,
        }
        with contextlib.suppress(OSError), Live(console=self._terminal, **options) as live:
            while not self._ended.is_set():
                self._draw(live)
                self._ended.wait(REFRESH_S)
            self._draw(live)

    def _draw(self, live: Live) -> None:
        state = self._status.as_object()
        if (state, self._terminal.size) == self._shown and not self._notes:
            return
        self._shown = (state, self._terminal.size)
        while self._notes:
            self._terminal.print(Text(self._notes.popleft()))
        live.update(picture(self._outline, self._name, state, self._terminal), refresh=True)


def picture(outline: Outline, name: str, state: dict[str, Any], terminal: Terminal) -> Group:
    """What is shown of a status (`Status.as_object`) and a table, by the name of its file.

    The terminal's size decides how much of the tree is shown, its character set how.
    """
    utf8 = terminal.encoding.lower().startswith("utf")
    room = max(terminal.size.height - AROUND - 1, 3)
    width = state["last_width_mm"]
    doing = [f"part {state['part']}", str(state["phase"]), f"{state['squeezes']} squeezes"]
    doing.insert(2, "no width yet" if width is None else f"last width {width:.2f} mm")
    lines = [
        Text.assemble((name, "bold"), "  ", "  ".join(doing)),
        _outcomes(state["outcomes"]),
        Text(
            f"{REFIT.partition(':')[0]}: see plan-refit" if state["refit_pays"] else "",
            "bold yellow",
        ),
        *(_line(row, utf8=utf8) for row in outline.rows(outline.way(state), room)),
        Text(),
        *(_part(part) for part in state["recent_parts"][-PARTS:]),
    ]
    for line in lines:
        line.no_wrap, line.overflow = True, "ellipsis" if utf8 else "crop"
    return Group(*lines)


def _outcomes(outcomes: dict[str, int]) -> Text:
    text = Text()
    for name, count in outcomes.items():
        if count or name in ("leaf", "reject", "unresolved"):
            text.append(f"{count} {name.upper()}  ", style=_style(name) if count else "dim")
    return text


def _line(row: Row, *, utf8: bool) -> Text:
    here, on_way = ("▶ ", "• ") if utf8 else ("> ", "* ")
    sign = here if row.now else on_way if row.taken else "  "
    style = "bold reverse" if row.now else "bold" if row.taken else "dim"
    return Text.assemble(sign, "   " * row.depth, (row.text, style))


def _part(part: dict[str, Any]) -> Text:
    leaf = "" if part["leaf"] is None else f" {part['leaf']}"
    squeezes = "1 squeeze" if len(part["path"]) == 1 else f"{len(part['path'])} squeezes"
    text = Text.assemble(
        f"part {part['part']}: ", (part["outcome"].upper() + leaf, _style(part["outcome"]))
    )
    more = [
        _pose(part.get("answer")),
        squeezes,
        part["audit"] and f"audit {part['audit']}",
        part["delivery"] and f"delivery {part['delivery']}",
    ]
    return text.append("".join(f", {word}" for word in [*more, part["reason"]] if word))


def _pose(answer: dict[str, Any] | None) -> str:
    """Which part it is, if the table tells; where it lies, or its drawing's datum, if the job names one."""
    if answer is None:
        return ""
    shown = answer["datum"] or answer
    name = " (datum)" if answer["datum"] else ""
    which = f"{answer['hypothesis']}, " if "hypothesis" in answer else ""
    return (
        f"{which}({shown['x_mm']:.2f}, {shown['y_mm']:.2f}) mm, {shown['angle_deg']:.1f} deg{name}"
    )


def _style(outcome: str) -> str:
    return {"leaf": "green", "reject": "yellow", "unresolved": "yellow"}.get(outcome, "red")
