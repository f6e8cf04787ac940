"""The directive `kept`: what a file of tests/bench/results says, as tables, so that no page copies a figure.

    ```{kept} squeeze
    ```

A name with a dash, such as `squeeze-speed`, is one of several tables of a file; `others` lists the
files that no page shows otherwise. Without its file a table is left out, and the page says how to make it.
"""

import json
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

RESULTS = Path(__file__).resolve().parents[3] / "tests" / "bench" / "results"
FEW_LINES = 40
"""Most lines of a file of which only names and values are known."""


def markdown(header: list[str], rows: list[list[object]]) -> str:
    """A table; text to the left, and columns of numbers to the right."""
    numbers = [
        all(str(row[k])[:1] in "-\N{MINUS SIGN}0123456789" for row in rows) for k in range(len(header))
    ]
    rules = ["---:" if number else "---" for number in numbers]
    cells = [header, rules, *[[str(cell).replace("|", "\\|") for cell in row] for row in rows]]
    return "\n".join("| " + " | ".join(line) + " |" for line in cells)


def percent(share: float, digits: int = 2) -> str:
    return f"{100 * share:.{digits}f} %"


def interval(rate: float, bounds: list[float]) -> str:
    return f"{100 * rate:.3f} ({100 * bounds[0]:.2f} to {100 * bounds[1]:.2f}) %"


def compared(kept: dict) -> str:
    """Rows of tools/table1: Table I, or the zoo."""
    header = ["row", "part", "materials", "the paper's robot", "method", "success (95 % interval)"]
    header += ["pose within goal", "wrong", "rejected", "unresolved", "squeezes, mean / most", "nodes"]
    header += ["compiled in"]
    rows = []
    for row in kept["rows"]:
        paper = "" if row["paper"] is None else percent(row["paper"], 1)
        name = [row["row"], row["part"], row["materials"], paper, row["method"]]
        if "no_plan" in row:
            rows.append([*name, "no plan", "", "", "", "", "", "", f"{row['compile_seconds']:.1f} s"])
            continue
        shares = [
            percent(row[key]) for key in ("within_rate", "wrong_rate", "reject_rate", "unresolved_rate")
        ]
        squeezes = f"{row['mean_squeezes']:.2f} / {row['max_squeezes']}"
        rate = interval(row["success_rate"], row["success_ci95"])
        rows.append([*name, rate, *shares, squeezes, row["nodes"], f"{row['compile_seconds']:.1f} s"])
    shown = [k for k in range(len(header)) if any(row[k] != "" for row in rows)]
    return markdown([header[k] for k in shown], [[row[k] for k in shown] for row in rows])


def records(kept: list[dict], **columns: str) -> str:
    """A table with a row a record; a column's name has `_` for spaces, its format names the fields."""
    rows = [[form.format(**record) for form in columns.values()] for record in kept]
    return markdown([name.replace("_", " ") for name in columns], rows)


def squeeze_speed(kept: dict) -> str:
    return records(
        kept["speed"],
        part="{part}",
        corners="{vertices}",
        squeezes_a_second_on_one_core="{per_second:.0f}",
        plain_numpy="{twin_per_second:.2g}",
        MuJoCo="{mujoco_per_second:.2g}",
        width_of_MuJoCo_within_1_mm="{mujoco_within_1_mm}",
    )


def squeeze_convergence(kept: dict) -> str:
    return records(
        kept["convergence"],
        part="{part}",
        disc="{disc_mm:g} mm",
        agrees_with_steps_a_twentieth_as_long="{close_percent:.2f} %",
        deepest_overlap="{deepest_mm:.3f} mm",
        given_up="{given_up}",
        squeezes_a_second="{per_second:.0f}",
    )


def squeeze_goldberg(kept: dict) -> str:
    found = kept["goldberg"]
    return (
        f"{found['squeezes']} squeezes of {found['polygons']} random polygons without friction, by fingers "
        f"longer than the part: {found['in_a_valley']} end in a valley of Goldberg's diameter function, "
        f"{found['grasped']} of them grasped."
    )


def bound(kept: list[dict]) -> str:
    return records(
        kept,
        part="{job}",
        squeezes="{mean_squeezes:.2f}",
        at_least="{squeezes:.2f}",
        by_leaves="{terms[leaves][squeezes]:.2f}",
        by_success="{terms[overall][squeezes]:.2f}",
        distance="{above_bound:.1%}",
        success_of_all_compared="{success_rate:.2%}",
        parts="{parts}",
        processor_time="{cpu_seconds:.0f} s",
    )


def kcde(kept: dict) -> str:
    rows = [
        [kept["points"], "this planner", f"{kept['ours_ms']:.1f} ms", f"{kept['particles_per_second']:.0f}"],
        [
            kept["points"], "scipy, 400 neighbours", f"{kept['scipy_ms']:.1f} ms",
            f"{1e3 * kept['particles'] / kept['scipy_ms']:.0f}",
        ],
        [
            kept["own_points"], "this planner", f"{kept['own_ms']:.1f} ms",
            f"{kept['own_particles_per_second']:.0f}",
        ],
    ]  # fmt: skip
    return markdown(
        ["learned from", "by", f"{kept['particles']} particles", "particles a second, one core"], rows
    )


def push_forward(kept: dict) -> str:
    header = ["part", "squeezes at", "the model used", "the paper's estimate"]
    rows = []
    for part, found in kept.items():
        if part == "setting":
            continue
        for angles in ("[0, 45, 90]", "[0, 90, 45]"):
            cells = [" ".join(f"{x:.2f}" for x in found[f"{name} {angles}"]["same"]) for name in METHODS]
            rows.append([part, angles.strip("[]") + "°", *cells])
    return markdown(header, rows)


METHODS = ("model", "paper")


def rollouts(kept: dict) -> str:
    table = records(
        [{**row, "read_ms": 1e3 * row["second_s"]} for row in kept["generate"]],
        part="{part}",
        poses="{count}",
        rolled_out="{rolled_out}",
        seconds="{first_s:.1f}",
        a_second="{per_second:.0f}",
        read_back_in="{read_ms:.0f} ms",
    )
    both = kept["cluster"]
    note = f"{both['count']} on a Dask cluster of {both['workers']} workers: {both['cluster_s']:.1f} s"
    return f"{table}\n\n{note}, on threads {both['threads_s']:.1f} s, the same bytes."


def runtime(kept: dict) -> str:
    limits, memory, decision = kept["limits"], kept["memory"], kept["decision"]
    rows = [
        ["resident memory", f"{memory['peak_mib']:.1f} MiB", f"{limits['rss_mib']:g} MiB"],
        [
            "start to first frame, slowest", f"{kept['first_frame_s']['max']:.2f} s",
            f"{limits['first_frame_s']:g} s",
        ],
        ["a decision, median", f"{decision['p50_us']:.1f} us", ""],
        [
            "a decision, undisturbed, the slowest of all nodes and counts",
            f"{decision['least_max_us']:.1f} us", f"{limits['decision_p9999_us']:g} us",
        ],
        [
            f"a decision, 99.99 % of {decision['decisions']}", f"{decision['p9999_us']:.0f} us",
            f"{limits['decision_p9999_us']:g} us",
        ],
        ["arithmetic of that length instead, 99.99 %", f"{decision['control_p9999_us']:.0f} us", ""],
    ]  # fmt: skip
    return markdown(["figure", "measured", "aim"], rows)


def mutation(kept: dict) -> str:
    rows = [
        [name, found["changes"], found["equivalent"], found["killed"], len(found["survivors"])]
        for name, found in kept["modules"].items()
    ]
    note = f"{percent(kept['score'], 1)} of all that alter anything were found."
    return f"{markdown(['module', 'changes', 'alter nothing', 'found', 'not found'], rows)}\n\n{note}"


def robustness(kept: dict) -> str:
    rows = [[f"`{command}`", found["did"], found["findings"]] for command, found in kept.items()]
    return markdown(["command", "what it did", "findings"], rows)


def camera(kept: dict) -> str:
    header = ["pictures", "found", "error, 95 %", "error, worst", "angle, 95 %", "a picture"]
    shown = {"the work area, true calibration": kept["work_area"], **kept["limits"]}
    rows = [
        [
            name, f"{found['pictures'] - found['missed']} of {found['pictures']}",
            *[f"{found[f'true_calibration_{key}']:.3f} {unit}" for key, unit in ERRORS],
            f"{found['ms_mean']:.0f} ms",
        ]
        for name, found in shown.items()
    ]  # fmt: skip
    own = kept["work_area"]
    rows.insert(
        1,
        [
            "the same, own calibration", rows[0][1],
            *[f"{own[f'own_calibration_{key}']:.3f} {unit}" for key, unit in ERRORS], rows[0][-1],
        ],
    )  # fmt: skip
    return markdown(header, rows)


ERRORS = (("mm_p95", "mm"), ("mm_max", "mm"), ("deg_p95", "°"))


def audit_loop(kept: dict) -> str:
    loop = kept["loop"]
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in loop["verdicts"].items())
    rows = [
        ["leaves judged", loop["at_leaves"]],
        ["verdicts", verdicts],
        ["parts truly within the goal", loop["truly_within"]],
        ["verdicts that agree with the truth", percent(loop["agreement"], 1)],
        ["false passes, false fails", f"{loop['false_passes']}, {loop['false_fails']}"],
        ["errors beyond the budget", loop["beyond_the_budget"]],
    ]
    return markdown(["what", "found"], rows)


def audit_drift(kept: dict) -> str:
    names = (
        "what goes wrong; noticed within 50 parts; at best; parts until then, median; most; charts that ring"
    )
    header = names.split("; ")
    rows = [
        [
            name, percent(found["flagged"], 1), percent(found["at_best"], 1) if "at_best" in found else "",
            f"{found['delay_median']:g}", found["delay_max"], ", ".join(found["by"]),
        ]
        for name, found in kept["drift"].items() if name != "runs"
    ]  # fmt: skip
    healthy = kept["healthy"]
    note = f"Nothing wrong: {sum(healthy['alarms'].values())} alarms in {healthy['parts']} parts."
    return f"{markdown(header, rows)}\n\n{note}"


def worlds(kept: dict) -> str:
    """Confident wrong answers of tests/bench/bench_worlds.py: a row a world, a column a plan."""
    plans = kept["rows"]
    header = ["world", *[f"{plan['part']}, {plan['plan']}" for plan in plans]]
    rows = [
        [name, *[percent(plan["worlds"][name]["wrong_rate"]) for plan in plans]]
        for name in plans[0]["worlds"]
    ]
    worst = [max(found["wrong_rate"] for found in plan["worlds"].values()) for plan in plans]
    planned = [plan["worlds"]["as planned"] for plan in plans]
    rows += [
        ["**the worst of them**", *[f"**{percent(rate)}**" for rate in worst]],
        ["squeezes, as planned", *[f"{found['mean_squeezes']:.2f}" for found in planned]],
        ["success, as planned", *[percent(found["success_rate"]) for found in planned]],
        ["planned in", *[f"{plan['seconds']:.0f} s" for plan in plans]],
    ]
    return markdown(header, rows)


def others(_: dict) -> str:
    """Every file that has no table of its own, as names and values."""
    known = {name.partition("-")[0] for name in TABLES}
    parts = []
    for path in sorted(RESULTS.glob("*.json")):
        if path.stem not in known:
            parts.append(f"**tests/bench/results/{path.name}**\n\n{listed(json.loads(path.read_text()))}")
    return "\n\n".join(parts) or "None so far."


def listed(kept: object) -> str:
    """What is kept as names and values, the first of them."""
    rows = [list(pair) for pair in flat(kept)]
    more = [["...", f"{len(rows) - FEW_LINES} more"]] if len(rows) > FEW_LINES else []
    return markdown(["what", "value"], rows[:FEW_LINES] + more)


def flat(value: object, name: str = "") -> list[tuple[str, object]]:
    """Names, with dots for depth, and values."""
    if isinstance(value, dict):
        return [pair for key, inner in value.items() for pair in flat(inner, f"{name}.{key}".lstrip("."))]
    if isinstance(value, list) and any(isinstance(inner, (dict, list)) for inner in value):
        return [pair for k, inner in enumerate(value, 1) for pair in flat(inner, f"{name}.{k}")]
    return [(name, f"{value:.4g}" if isinstance(value, float) else value)]


TABLES = {
    "table1": compared,
    "zoo": compared,
    "bound": bound,
    "worlds": worlds,
    "squeeze-speed": squeeze_speed,
    "squeeze-convergence": squeeze_convergence,
    "squeeze-goldberg": squeeze_goldberg,
    "kcde": kcde,
    "push_forward": push_forward,
    "rollouts": rollouts,
    "runtime": runtime,
    "mutation": mutation,
    "robustness": robustness,
    "camera": camera,
    "audit-loop": audit_loop,
    "audit-drift": audit_drift,
}


def table_of(name: str) -> str:
    """The Markdown that a name stands for.

    Raises:
        KeyError: there is no table of that name.
    """
    if name == "others":
        return others({})
    path = RESULTS / f"{name.partition('-')[0]}.json"
    if name in TABLES and not path.exists():
        return "Not measured in this version."
    table, kept = TABLES[name], json.loads(path.read_text())
    try:
        return table(kept)
    except (KeyError, TypeError, AttributeError):  # a benchmark that keeps other figures than it did
        _, _, part = name.partition("-")
        return listed(kept.get(part, kept))


class Kept(SphinxDirective):
    """See the module."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        name = self.arguments[0]
        try:
            text = table_of(name)
        except KeyError:
            raise self.error(f"no table {name}; there are {', '.join(TABLES)} and others") from None
        for path in RESULTS.glob("*.json"):
            self.env.note_dependency(str(path))
        return [nodes.container("", *self.parse_text_to_nodes(text), classes=["kept"])]


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("kept", Kept)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
