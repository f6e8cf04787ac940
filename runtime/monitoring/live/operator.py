"""Writes the HTML of the operator's view: state, yield, takt, lost parts, widths, last parts, table.

The browser only inserts this HTML into the live page. All text from files and devices is escaped.
"""

from collections.abc import Iterator, Mapping
from html import escape
from math import degrees
from pathlib import Path
from typing import Any

from runtime.pages.charts import Bar, Line, bars, trend
from runtime.pages.frame import cards, table, verdict
from runtime.shell.plain_text import capital
from runtime.spc.monitor import MEANING, REFIT, STEADY
from runtime.table import PPM, Table

PHASES = {
    "idle": "waiting for the next part",
    "resume": "going on after a run that broke off",
    "push": "pushing",
    "place": "moving to the part",
    "squeeze": "squeezing",
    "read": "reading the width",
    "release": "opening",
    "audit": "looking with the camera",
    "deliver": "delivering",
    "safe": "stopping in a safe state",
    "done": "part done",
}
KINDS = {
    "reject": "Rejected",
    "unresolved": "Not located",
    "fault": "Fault",
    "stopped": "Stopped by the operator",
    "aborted": "Given up",
    "audit": "Refuted by the camera",
    "delivery": "Not delivered",
}
HEADS = ("part", "outcome", "lies at", "squeezes", "seconds", "audit", "why")
CHANGE = (Path(__file__).parent / "templates" / "change.html").read_text("utf-8")
NONE = "\N{EN DASH}"
Outlines = list[list[list[float]]]  # outline (n, 2) of each hypothesis [mm]; empty if unknown


def state(seen: Mapping[str, Any]) -> str:
    """The HTML that shows in large letters what the cell is doing, or how the run ended.

    Args:
        seen: the run's status (`Status.as_object`).
    """
    if seen["end"] is not None:
        last = seen["last_part"] or {"reason": None, "safe_state": []}
        said = [last["reason"], *last["safe_state"]] if seen["end"]["grade"] != "good" else []
        why = f"<p>{escape(capital('; '.join(filter(None, said))))}</p>" if any(said) else ""
        return f"<div data-ended>{verdict(**seen['end'])}{why}</div>"
    part = f"Part {seen['part']}: " if seen["part"] else ""
    doing = PHASES[seen["phase"]]
    return verdict("fair" if seen["phase"] == "safe" else "good", f"{part}{doing}", "Running.")


def screen(loaded: Table, outlines: Outlines, seen: Mapping[str, Any]) -> str:
    """The HTML below the state: warnings, figures, lost parts, widths, last parts and table.

    Args:
        loaded: the table.
        outlines: outlines of the table's parts.
        seen: the run's status (`Status.as_object`).
    """
    return "\n".join(
        [
            *_signs(seen),
            cards(_figures(seen)),
            '<div class="halves">',
            *("<section><h2>What costs parts</h2>", *_losses(loaded, outlines, seen), "</section>"),
            *("<section><h2>Widths</h2>", *_widths(seen["charts"]), "</section>"),
            "</div>",
            "<h2>The last parts</h2>",
            table("The last parts", HEADS, map(_part, reversed(seen["recent_parts"]))),
            "<h2>The table</h2>",
            *_loaded(loaded, seen),
        ]
    )


def _signs(seen: Mapping[str, Any]) -> Iterator[str]:
    """Yields HTML warnings: for each alarm of the control charts, and if `plan-refit` would pay."""
    for alarm in seen["charts"]["alarms"]:
        yield verdict("fair", f"{capital(alarm['sentence'])} (part {alarm['number']}).")
    if seen["refit_pays"]:
        yield verdict("fair", f"{capital(REFIT)}.")


def _figures(seen: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    shift = seen["shift"]
    parts, since = shift["parts"], f"since {shift['since'][11:]}"
    located = f"{100 * shift['good'] / parts:.1f} %" if parts else NONE
    yield "Good parts this shift", located, f"{shift['good']} of {parts} parts {since}"
    mean, takt, share = shift["seconds_mean"], shift["takt_s"], shift["takt_share"]
    within = "mean; --takt states what it may be" if takt is None else f"the takt is {takt:g} s"
    if share is not None:
        within = f"{100 * share:.1f} % within the takt of {takt:g} s"
    yield "Seconds a part", NONE if mean is None else f"{mean:.1f} s", within
    width = seen["last_width_mm"]
    squeeze = f"squeeze {len(seen['steps'])} of this part" if seen["steps"] else ""
    yield "Last width", NONE if width is None else f"{width:.2f} mm", squeeze
    located_parts = [part for part in seen["recent_parts"] if part["answer"]]
    last = located_parts[-1] if located_parts else None
    where, angle = _pose(last["answer"]) if last else (NONE, "")
    yield "Last answer", where, f"{angle}, part {last['part']}" if last else ""


def _pose(answer: Mapping[str, Any]) -> tuple[str, str]:
    """Writes the pose of a located part as two texts: the position, and the angle.

    The pose is that of the drawing's datum if the job names a datum. In a table of several parts the second
    text begins with the part's name.
    """
    shown = answer["datum"] or answer
    which = f"{answer['hypothesis']}, " if "hypothesis" in answer else ""
    datum = " (datum)" if answer["datum"] else ""
    # zero is shown as 0.00, not as -0.00
    x_mm, y_mm, angle = (round(shown[name], 2) + 0.0 for name in ("x_mm", "y_mm", "angle_deg"))
    return f"{x_mm:.2f}, {y_mm:.2f} mm", f"{which}{angle:.1f}°{datum}"


def _losses(loaded: Table, outlines: Outlines, seen: Mapping[str, Any]) -> Iterator[str]:
    losses = seen["shift"]["losses"]
    if not losses:
        yield '<p class="note">No part was lost in this shift.</p>'
        return
    parts = seen["shift"]["parts"]
    named = [(_named(loss), loss) for loss in losses]
    yield bars(
        "Parts lost in this shift",
        [
            Bar(name, loss["parts"], f"{loss['parts']} ({100 * loss['parts'] / parts:.1f} %)")
            for name, loss in named
        ],
    )
    yield '<div class="losses">'
    for name, loss in named:
        said = f"{name}. Last: part {loss['part']}"
        why = f", {loss['reason']}." if loss["reason"] else "."
        drawn = picture(loaded, outlines, loss["node"] or 0, loss["width_mm"])
        yield f"<figure>{drawn}<figcaption>{escape(said + why)}</figcaption></figure>"
    yield "</div>"
    if outlines:
        yield (
            '<p class="note">Red: the fingers at the width that was read. Blue: where a part lies after the '
            "planned outcome that is nearest.</p>"
        )


def _named(loss: Mapping[str, Any]) -> str:
    kind = KINDS[loss["kind"]]
    return f"{kind} after squeeze {loss['squeeze']}" if loss["squeeze"] else kind


def picture(loaded: Table, outlines: Outlines, node: int, width_mm: float | None) -> str:
    """Draws the last squeeze of a lost part as SVG, to scale: the fingers, and where a part usually lies.

    The part is drawn at the pose of the leaf that parts reach most often after such a width (`_usual`). It is
    left out if that leaf is unresolved, if the goal asks for no pose, or if its outline is unknown.

    Args:
        loaded: the table.
        outlines: outlines of the table's parts.
        node: index of the squeeze's node.
        width_mm: distance between the fingers; None: the fingers are drawn open.
    """
    squeeze, gripper = loaded.nodes[node].squeeze, loaded.gripper
    half = 0.5 * (squeeze.opening_um / 1000 if width_mm is None else width_mm)
    length, thick = gripper.finger_length_um / 1000, gripper.finger_width_um / 1000
    boxes = "".join(
        f'<rect class="finger" x="{-length / 2:.2f}" y="{y:.2f}" width="{length:.2f}" height="{thick:.2f}"/>'
        for y in (half, -half - thick)
    )
    inside = _moved(boxes, squeeze.x_um, squeeze.y_um, squeeze.angle_urad)
    leaf = loaded.leaves[_usual(loaded, node, width_mm)]
    if outlines and leaf.resolved and loaded.goal.kind != "identity":
        points = " ".join(f"{x:.2f},{y:.2f}" for x, y in outlines[leaf.hypothesis])
        drawn = f'<polygon class="part" points="{points}"/>'
        inside = _moved(drawn, leaf.x_um, leaf.y_um, leaf.theta_urad) + inside
    far = 0.5 * gripper.opening_um / 1000 + thick
    label = "fingers open" if width_mm is None else f"fingers {width_mm:.2f} mm apart"
    return (
        f'<svg class="scene" viewBox="{-far:.1f} {-far:.1f} {2 * far:.1f} {2 * far:.1f}" role="img" '
        f'aria-label="Node {node}, {label}"><g transform="scale(1 -1)">{inside}</g></svg>'
    )


def _moved(drawn: str, x_um: int, y_um: int, angle_urad: int) -> str:
    place = f"translate({x_um / 1000:.2f} {y_um / 1000:.2f})rotate({degrees(angle_urad / 1e6):.1f})"
    return f'<g transform="{place}">{drawn}</g>'


def _usual(loaded: Table, node: int, width_mm: float | None) -> int:
    """Index of the leaf that parts reach most often after a squeeze with a given width.

    Args:
        loaded: the table.
        node: index of the squeeze's node.
        width_mm: the width, which selects the branch with the nearest expected width; None selects the
            likeliest branch.
    """
    branches = loaded.nodes[node].branches
    target = max(branches, key=lambda branch: branch.probability_ppm).target
    if width_mm is not None:
        target = min(branches, key=lambda branch: abs(branch.expected_um - 1000 * width_mm)).target
    while target >= 0:
        target = max(loaded.nodes[target].branches, key=lambda b: b.probability_ppm).target
    return ~target


def _widths(charts: Mapping[str, Any]) -> Iterator[str]:
    if not charts["wider"]:
        yield '<p class="note">Nothing was squeezed yet.</p>'
        return
    drift = any(alarm["chart"] == "widths" for alarm in charts["alarms"])
    grade, sentence = ("fair", MEANING["widths"]) if drift else ("good", STEADY["widths"])
    yield verdict(grade, f"{capital(sentence)}.")
    lines = [Line(name, charts[name]) for name in ("wider", "narrower")]
    limit = charts["limit"]
    yield trend("Widths against the plan", lines, (-limit, limit), "squeeze")
    yield (
        '<p class="note">Evidence for fingers that stop wider or narrower than planned. At a dashed line, '
        "check the gripper; the line then restarts at 0.</p>"
    )


def _part(part: Mapping[str, Any]) -> Iterator[str]:
    where = ", ".join(_pose(part["answer"])) if part["answer"] else ""
    seconds = "" if part["seconds"] is None else f"{part['seconds']:.1f}"
    yield from (str(part["part"]), part["outcome"], where, str(len(part["path"])), seconds)
    yield from (part["audit"] or "", part["reason"] or "")


def _loaded(loaded: Table, seen: Mapping[str, Any]) -> Iterator[str]:
    predicted = f"{100 * loaded.predicted.success_ppm / PPM:.2f} % located"
    facts = (
        ("file", seen["table"]),
        ("digest (SHA-256)", f"{seen['table_sha256'][:16]}…"),
        ("expected", predicted if loaded.predicted.trials else "not tried"),
        ("squeezes planned", str(len(loaded.nodes))),
    )
    rows = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts)
    yield f'<dl class="facts">{rows}</dl>'
    yield CHANGE
