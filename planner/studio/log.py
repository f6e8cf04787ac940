"""The log of a plan: lines of JSON, with messages of commands in between."""

import math
from typing import Any, NamedTuple

from planner.evaluation.shares import in_percent, shares_of
from runtime.shell import strict_json

KERNELS = "kernels"  # the stage that compiles kernels, once an installation
MOST_LINES = 40


class Log(NamedTuple):
    """State of a plan, read from its log, for a page to show."""

    drawing: str
    commands: list[str]
    step: str  # the current command, or the last one
    progress: dict[str, Any]  # last reported stage
    answer: dict[str, Any] | None  # answer of `squeezetree try`, as texts
    parts: list[dict[str, Any]]  # simulated parts, as texts; `path` and `squeezes` are for `film`
    tried: list[dict[str, Any]]  # trials of other discs and goals, as texts
    lines: list[str]  # latest messages; if a command failed, they say why
    exit: int | None  # exit code of the last command; None while it runs, or where it was killed


def log_of(data: bytes) -> Log:
    """Reads the log of a plan.

    Any bytes are accepted, since other programs may write to the file: a line that is no valid record becomes
    a message.
    """
    log, squeezes = Log("", [], "", {}, None, [], [], [], None), list[dict[str, Any]]()
    for line in data.decode("utf-8", "replace").splitlines():
        try:
            record = strict_json.parse(line)
            if "squeezed" in record:
                squeezed = dict(record["squeezed"])
                if squeezes and squeezes[-1]["before"] == squeezed["before"]:
                    squeezes.pop()  # a fast and then a slow closing are one squeeze
                squeezes.append(squeezed)
            else:
                log = _with(log, record, squeezes)
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError):
            if line.strip():
                log.lines.append(line.strip())
    return log._replace(lines=log.lines[-MOST_LINES:])


def _with(log: Log, record: dict[str, Any], squeezes: list[dict[str, Any]]) -> Log:
    if "step" in record:
        log.commands.append(str(record["command"]))
        step, drawing = str(record["step"]), str(record["drawing"])
        return log._replace(step=step, drawing=drawing, progress={}, lines=[])
    if "stage" in record:
        share = record["share"]
        known = isinstance(share, int | float) and record["stage"] != KERNELS
        texts = {key: str(record[key]) for key in ("stage", "left", "detail")}
        figures = {"seconds": float(record["seconds"]), "share": share if known else None}
        return log._replace(progress={**texts, **figures})
    if "verdict" in record:
        return log._replace(answer=_answer(record))
    if "outcome" in record:
        path = list(record["path"])
        # The cell also squeezes once before the first part.
        latest = squeezes[len(squeezes) - len(path) :]
        log.parts.append({**_part(record), "path": path, "squeezes": latest})
        return log
    if "tried" in record:
        log.tried.append(_tried(record))
        return log
    if "exit" in record:
        code = int(record["exit"])
        return log._replace(exit=code, lines=log.lines if code else [])
    if "output" not in record:  # message of plan-report
        raise ValueError
    return log


def _answer(record: dict[str, Any]) -> dict[str, Any]:
    """Converts a verdict record to texts for the page: grade, sentences and, with a plan, three figures."""
    answer: dict[str, Any] = {
        "grade": str(record["verdict"]),
        "answer": str(record["answer"]),
        "sentence": f"The plan {record['sentence']}." if "sentence" in record else "",
        "warnings": [str(line) for line in record.get("warnings", ())],
        "limits": [str(line) for line in record.get("limits", ())],
        "assumed": [str(line) for line in record["assumed"]],
        "numbers": [],
    }
    if "success_rate" in record:
        error = record["error_mm"]
        far = "none located" if error is None else f"{error['median']:.2f} mm"
        more = "" if error is None else f"median; 95 % within {error['p95']:.2f} mm"
        shares = shares_of(record)
        mean, most = record["mean_squeezes"], record["max_squeezes"]
        squeezes = f"a part; {mean:.2f} squeezes, {most} at most"
        others = f"{in_percent(shares.wrong)} wrong, of {record['trials']} trials"
        answer["numbers"] = [
            {"what": "located", "value": in_percent(shares.located), "more": others},
            {"what": "seconds", "value": f"{record['seconds_mean']:.1f} s", "more": squeezes},
            {"what": "error", "value": far, "more": more},
        ]
    return answer


def _tried(record: dict[str, Any]) -> dict[str, Any]:
    what = {"uncertainty.radius_mm": "off by at most", "goal.distance_mm": "located to"}
    return {
        "what": f"{what[record['tried']]} {float(record['value']):g} mm",
        "located": f"{100 * float(record['located']):.1f} % located",
        "enough": record["enough"] is True,
        "command": str(record["command"]),
    }


def _part(record: dict[str, Any]) -> dict[str, Any]:
    pose, error = record["predicted_pose"], record["error_mm"]
    where = "" if pose is None else f"({pose['x_mm']:.2f}, {pose['y_mm']:.2f}) mm"
    return {
        "number": int(record["part"]),
        "outcome": str(record["outcome"]).upper(),
        "widths": ", ".join(f"{width:.2f}" for width in record["widths_mm"]),
        "place": where,
        "angle": "" if pose is None else _degrees(pose["theta_rad"]),
        "error": "" if error is None else f"{error:.2f}",
        "within": record["within_goal"] is True,
    }


def _degrees(rad: float) -> str:
    return f"{round(math.degrees(rad), 1) + 0.0:.1f}"  # no turn is 0.0, not -0.0
