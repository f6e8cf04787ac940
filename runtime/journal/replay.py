"""Replay of a journal: derives every decision again, from the recorded readings and the embedded tables.

A replay runs the same program for a part (`traversal.program`) as the executor. It reports records that
contradict the program, and a resumed run continues where the replay ends.
"""

import base64
from collections.abc import Iterable, Iterator
from enum import Enum
from typing import NamedTuple

from drivers.ports import ObjectState
from runtime.journal.lines import Entry
from runtime.table import Calibration, Table, loads
from runtime.traversal.decision import Policy, TraversalState
from runtime.traversal.program import Program, Reading, released
from runtime.traversal.results import EXIT_CODES, Outcome, Step

DECIDED = {outcome.value: outcome for outcome in (Outcome.LEAF, Outcome.REJECT, Outcome.UNRESOLVED)}
UNDECIDED = {outcome.value for outcome in Outcome} - DECIDED.keys()


class Last(Enum):
    """What the hand may have been doing since a part's latest record was written."""

    AWAY = "away"  # the hand touches nothing
    PUSHING = "pushing"  # the hand is between the first push and the place of the squeeze
    PLACED = "placed"  # the hand is at the node's place; the squeeze may be under way
    SQUEEZED = "squeezed"  # the reading is decided, the part may still be held


class Finding(NamedTuple):
    """A contradiction: what the record number `seq` states does not follow from the records before it."""

    seq: int
    sentence: str


class Replay:
    """Follows the records of a journal; its attributes are the state of the latest run so far."""

    def __init__(self) -> None:
        self.table: Table | None = None
        self.header: Entry = {}
        self.policy = Policy()
        self.closed = True  # whether the run's last record was seen
        self.over = False  # whether the outcome of the last part ends a run
        self.decisions = 0  # squeezes derived so far, over all runs
        self.parts = 0  # parts with an outcome
        # The node of the latest squeeze, and the target of its reading: None before the reading, and after
        # `REJECT`. If `last` is AWAY, the fingers have released the part since.
        self.held_at: tuple[int, int | None] | None = None
        self._found: int | None = None  # the leaf whose delivery was begun
        self._begin(None)

    def follow(self, entries: Iterable[Entry]) -> Iterator[Finding]:
        """Goes through a journal's records in order, and yields a finding for each contradiction."""
        for entry in entries:
            seq = int(str(entry["seq"]))
            try:
                yield from (Finding(seq, sentence) for sentence in self._take(entry))
            except Exception as error:  # a journal is a file that anybody may have written
                yield Finding(seq, f"record {entry.get('kind')!r} cannot be followed: {error!r}")

    def _take(self, entry: Entry) -> Iterator[str]:
        kind = entry["kind"]
        if kind == "header":
            self._open(entry)
        elif kind == "part":
            self.over = False  # a robot that uses --serve continues after a part that was given up
            self._begin(_integer(entry, "part"))
            self.parts = _integer(entry, "part") - 1
        elif kind == "turned":
            self.turn_urad = _integer(entry, "turn_urad")
        elif kind == "resume" and entry["how"] == "restart":
            self.traversal = TraversalState()
            self.steps.clear()
        elif kind in ("pushing", "placed"):
            yield from self._expect(entry)
            self.last, self.held_at = Last(kind), (_integer(entry, "node"), None)
            self.traversal = self.traversal._replace(again=kind == "placed")
        elif kind == "squeeze":
            yield from self._squeeze(entry)
        elif kind == "freed":
            self.last = Last.AWAY
        elif kind == "delivery":
            self.delivering, self._found = entry["begun"] is True, self.traversal.leaf
        elif kind == "outcome":
            yield from self._end(entry)
        elif kind == "end":
            self.closed = True

    def _open(self, entry: Entry) -> None:
        table = loads(base64.b64decode(str(entry["table_base64"]), validate=True))
        self.table, points = table, entry.get("calibration_um")
        measured = points if isinstance(points, list) else []
        points_um = tuple((int(nominal), int(true)) for nominal, true in measured)
        self.calibration = Calibration(table.gripper.profile, points_um)
        self.policy = Policy.of(
            str(entry.get("on_reject", "next")), str(entry.get("on_unresolved", "next"))
        )
        self._program = Program(table, self.calibration, self.policy)
        self.header, self.closed, self.over = entry, False, False
        # The header of a segment within a run: the parts before it are in earlier segments.
        self.parts = _integer(entry, "after_part") if "after_part" in entry else 0
        self._begin(None)

    def _begin(self, part: int | None) -> None:
        self.part = part  # number of the part under way; None if none is
        self.turn_urad = 0  # angle by which the part's plan is turned about the origin
        self.steps: list[Step] = []
        self.traversal = TraversalState()
        self.delivering = False  # whether the part was being carried
        self._found = None
        self.last, self.held_at = Last.AWAY, None

    def _expect(self, entry: Entry) -> Iterator[str]:
        """Yields one sentence if a record names a wrong part, and one if it names a wrong node.

        The right part is the current one. The right node is the one at which the part is to be squeezed next.
        """
        if entry.get("part") != self.part:
            yield f"is of part {entry.get('part')}, under way is {self.part}"
        if entry["node"] != self.traversal.node or self.traversal.outcome is not None:
            yield f"is at node {entry['node']}, the path leads to {_sketch(self.traversal)}"

    def _squeeze(self, entry: Entry) -> Iterator[str]:
        yield from self._expect(entry)
        index, reading_um = _integer(entry, "node"), _integer(entry, "reading_um")
        reading = Reading(reading_um, ObjectState(_integer(entry, "object_flag")))
        # If the record is at another node than the path, the replay continues from there.
        state = self.traversal._replace(node=index, outcome=None)
        requests = self._program.part(_integer(entry, "part"), state, self.steps)
        release = released(requests, next(requests), reading)
        target, width_um = release.step.target, release.step.width_um
        if entry["target"] != target:
            yield f"says that {width_um} um leads to {entry['target']}, the table says {target}"
        if entry["width_um"] != width_um:
            said = f"says that a reading of {reading_um} um is {entry['width_um']} um"
            yield f"{said}, the calibration says {width_um}"
        self.steps, self.traversal = [*release.steps], release.after
        self.last, self.held_at = Last.SQUEEZED, (index, target)
        self.decisions += 1

    def _end(self, entry: Entry) -> Iterator[str]:
        outcome = DECIDED.get(str(entry["outcome"]))
        if outcome is None and entry["outcome"] not in UNDECIDED:
            yield f"has the unknown outcome {entry['outcome']!r}"
        if outcome is None and entry.get("leaf") not in (None, self._found):
            yield f"reports leaf {entry['leaf']} with the outcome {entry['outcome']}"
        if outcome is not None:
            if (outcome, entry.get("leaf")) != (self.traversal.outcome, self.traversal.leaf):
                message = f"{outcome.name}, leaf {entry.get('leaf')}"
                yield f"reports {message}; the path leads to {_sketch(self.traversal)}"
            missed = entry.get("delivery") == "missed"
            if entry.get("exit_code") != EXIT_CODES[outcome] and not missed:
                yield f"reports exit code {entry.get('exit_code')}, {outcome.name} has {EXIT_CODES[outcome]}"
        if self.part is None and outcome is not None:
            yield f"reports {outcome.name}; no part is under way"
        # A stop request may come just after a part's outcome, and record that part once more.
        self.parts += self.part is not None
        self.over = self.policy.ends_run(Outcome(entry["outcome"]))
        self._begin(None)


def _sketch(traversal: TraversalState) -> str:
    if traversal.outcome is None:
        return f"node {traversal.node}"
    return f"{traversal.outcome.name}, leaf {traversal.leaf}"


def _integer(entry: Entry, name: str) -> int:
    value = entry[name]
    if type(value) is not int:
        raise ValueError(f"{name} is {value!r}, not an integer")
    return value
