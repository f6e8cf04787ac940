"""Drift of a cell during a run: the control charts of its table, part after part."""

from runtime.spc.history import Part, Squeezed
from runtime.spc.monitor import Alarm, Monitor
from runtime.table import Table
from runtime.traversal.results import PartResult

LEAST_REFIT = 20  # least parts for a refit
DRIFTED = ("widths", "branches", "readings", "rejects")  # charts of quantities that a refit learns
REFIT = "a refit would pay: plan-refit JOB.toml --journal J... -o JOB2.toml learns what is off in the cell"
RECENT = 120  # squeezes whose chart values are kept


class Drift:
    """The control charts of a table, fed during a run; `add` returns whether a refit would pay."""

    def __init__(self, table: Table) -> None:
        self._table, self._charts = table, Monitor(table, keep=RECENT)
        self._drifted = False
        self._alarms: dict[str, Alarm] = {}  # the latest of each chart

    def as_object(self) -> dict[str, object]:
        """The latest cumulative sums of widths, their limit, and the latest alarm of each chart."""
        drawn = self._charts.drawn
        return {
            **{name: [round(v, 2) for v in drawn[name]] for name in ("wider", "narrower")},
            "limit": self._charts.widths.limit,
            "alarms": [alarm._asdict() for alarm in self._alarms.values()],
        }

    def add(self, result: PartResult) -> bool:
        """Adds a part that has ended; returns whether a refit would pay now."""
        nodes = self._table.nodes
        squeezes = (
            Squeezed(step.node, nodes[step.node].branch_to(step.target), step.width_um)
            for step in result.steps
        )
        part = Part(result.part, tuple(squeezes), result.outcome.value, result.leaf, result.audit)
        alarms = self._charts.add(part)
        self._alarms |= {alarm.chart: alarm for alarm in alarms}
        self._drifted |= any(alarm.chart in DRIFTED for alarm in alarms)
        return self._drifted and self._charts.parts >= LEAST_REFIT
