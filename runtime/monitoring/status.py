"""The status of a run, as a JSON object for the live page or as text for Prometheus."""

import threading
from collections import Counter, deque
from collections.abc import Mapping
from typing import Any

from runtime.execution.events import Phase
from runtime.monitoring.shift import Shift
from runtime.spc.monitor import Drift
from runtime.table import PPM, TableFile
from runtime.traversal import answer
from runtime.traversal.results import Outcome, PartResult, Step

RECENT = 10  # parts listed in a snapshot


class Status:
    """What a run has done so far and does now. The run's thread updates it, and any thread may read it."""

    def __init__(self, name: str, loaded: TableFile, shift: Shift) -> None:
        self._name, self._loaded, self._shift = name, loaded, shift
        self._frames = answer.frames_of(loaded.table)
        self._drift, self._refit = Drift(loaded.table), False
        self._predicted = loaded.table.predicted.success_ppm / PPM
        self._end: dict[str, str] | None = None
        self.watched = threading.Event()  # set whenever a page in a browser receives the status
        self._lock = threading.Lock()
        self._phase, self._part, self._squeezes = Phase.IDLE, 0, 0
        self._node: int | None = None
        self._width_mm: float | None = None
        self._outcomes: Counter[Outcome] = Counter()
        self._audits: Counter[str] = Counter()
        self._leaves: Counter[int] = Counter()
        self._steps: list[dict[str, object]] = []
        self._recent: deque[dict[str, object]] = deque(maxlen=RECENT)

    def phase(self, part: int, phase: Phase, node: int | None) -> None:
        """Records a change of phase."""
        with self._lock:
            if part != self._part:
                self._steps = []
            self._part, self._phase, self._node = part, phase, node

    def step(self, step: Step) -> None:
        """Records a squeeze that has ended."""
        with self._lock:
            self._squeezes += 1
            self._width_mm = width_mm = step.width_um / 1000
            self._steps.append({"node": step.node, "width_mm": width_mm, "target": step.target})

    def part(self, result: PartResult) -> None:
        """Records the result of a part."""
        with self._lock:
            self._outcomes[result.outcome] += 1
            said = None
            if result.leaf is not None and result.outcome is Outcome.LEAF:
                said = answer.fields(self._loaded.table, result, self._frames)
            self._recent.append({**result.fields(), "answer": said})
            self._refit = self._drift.add(result)
            self._shift.add(result)
            if result.leaf is not None:
                self._leaves[result.leaf] += 1
            if result.audit is not None:
                self._audits[result.audit] += 1

    def end(self, grade: str, sentence: str) -> None:
        """Records how the run ended.

        Args:
            grade: "good" if nobody has to do anything, else "fair" or "poor".
            sentence: how the run ended.
        """
        with self._lock:
            self._end = {"grade": grade, "sentence": sentence}

    def as_object(self) -> dict[str, Any]:
        """The status in the form of JSON.

        `steps` lists the squeezes of the current part; until the next part begins, those of the last part.
        The `target` of a step is a node if it is 0 or more, the leaf ~target if it is negative, and null
        after a reject. `recent_parts` lists the last parts, the latest at the end; their `answer` is the pose
        of a located part. `shift` holds the counts of `Shift`, and `charts` the figures of `Drift`. `end` is
        null during the run.
        """
        with self._lock:
            return {
                "table": self._name,
                "table_sha256": self._loaded.digest,
                "predicted_success": self._predicted,
                "phase": self._phase.value,
                "part": self._part,
                "node": self._node,
                "last_width_mm": self._width_mm,
                "squeezes": self._squeezes,
                "steps": list(self._steps),
                "outcomes": {outcome.value: self._outcomes[outcome] for outcome in Outcome},
                "audits": dict(self._audits),
                "refit_pays": self._refit,
                "shift": self._shift.as_object(),
                "charts": self._drift.as_object(),
                "end": self._end,
                "last_part": self._recent[-1] if self._recent else None,
                "recent_parts": list(self._recent),
            }

    def as_metrics(self) -> str:
        """The status in Prometheus' text format 0.0.4."""
        with self._lock:
            outcomes = {outcome.value: self._outcomes[outcome] for outcome in Outcome}
            phases = {phase.value: int(phase is self._phase) for phase in Phase}
            leaves, audits = dict(sorted(self._leaves.items())), dict(sorted(self._audits.items()))
            promise = "Share within the goal that the table promises."
            metrics = (
                ("squeezes_total", "Squeezes so far.", {"": self._squeezes}),
                ("part", "Number of the part under way.", {"": self._part}),
                ("parts_total", "Parts by outcome.", _labelled("outcome", outcomes)),
                ("phase", "1 for what the cell is doing.", _labelled("phase", phases)),
                ("leaves_total", "Parts by the leaf they ended at.", _labelled("leaf", leaves)),
                ("audits_total", "Parts by the auditor's verdict.", _labelled("verdict", audits)),
                ("predicted_success_ratio", promise, {"": self._predicted}),
            )
        return "".join(_metric(*metric) for metric in metrics)


def _labelled(label: str, values: Mapping[Any, float]) -> dict[str, float]:
    return {f'{{{label}="{name}"}}': value for name, value in values.items()}


def _metric(name: str, help_text: str, values: dict[str, float]) -> str:
    """Writes the lines of a metric in Prometheus' text format.

    Args:
        name: name of the metric, without the prefix "squeezetree_". The metric is a counter if its name ends
            in `_total`, else a gauge.
        help_text: what the metric is.
        values: the values by their labels.
    """
    name, kind = f"squeezetree_{name}", "counter" if name.endswith("_total") else "gauge"
    lines = [f"# HELP {name} {help_text}", f"# TYPE {name} {kind}"]
    lines += [f"{name}{labels} {value:g}" for labels, value in values.items()]
    return "\n".join(lines) + "\n"
