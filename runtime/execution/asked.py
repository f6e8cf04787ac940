"""Answers a robot that asks `grasp-runtime --serve` where to squeeze, and itself moves hand and jaws.

Robot and runtime exchange lines of text by the protocol in `tools/docs/serve.md`: each line of the robot gets
one answer. What an answer requests, a squeeze or a drag, is decided by `traversal.program`. Between
two lines the robot may do anything.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import degrees

from drivers.ports import MOST_COUNT, ObjectState, Settled
from runtime.devices.clock import SystemClock
from runtime.errors import GripperStateError, TableError
from runtime.execution.events import Console, Phase, Tally
from runtime.execution.executor import RunOptions
from runtime.execution.reading import check_closed, room_um
from runtime.execution.watch import DEADLINE_FACTOR, expected_of
from runtime.journal.chain import Journal
from runtime.shell.plain_text import cleaned
from runtime.table import HELD_UM, REJECT, DecisionMap, Table, decide
from runtime.table.geometry import placement, sent
from runtime.traversal import program
from runtime.traversal.answer import outcome_fields
from runtime.traversal.results import Outcome, PartResult, Step

VERSION = 1
MAX_LINE = 80  # including the line end: limit of a string in RAPID (RAPID reference)
MAX_NAME = 20  # characters of a part's name, so that a line with it stays below `MAX_LINE`
SLOWEST_UM_S = 20_000  # speed of a stroke assumed for an unknown gripper
NUMBER = re.compile(r"[+-]?\d{1,4}(\.\d{0,9})?([eE][+-]?\d{1,2})?")
FLAGS = {"OBJECT": ObjectState.CLOSING, "NONE": ObjectState.AT_TARGET}
UNTRIED = -1.0  # in place of the success of a leaf at which no trial ended

# Errors 10 to 12 and 20 to 23 leave the request due; the others end the connection and the current
# part.
ERRORS = {
    10: "not understood; there are NEXT WIDTH COUNTS STATUS RESET TABLE VERSION",
    11: "no reading is due; send NEXT",
    12: "a reading is due; send WIDTH or COUNTS",
    13: "a line came before the one before it was answered",
    14: "a line is too long, or its end is missing",
    20: "impossible: these jaws have no such width or count",
    21: "stale: the jaws stand as wide as they were opened",
    22: "stale: the reading names another node than the one that is due",
    23: "contradiction: closed on nothing, and yet open",
    30: "another robot is connected; one at a time",
    31: "too late: the part is given up",
    40: "the run has ended",
    41: "the journal cannot be written",
}


def refused(number: int) -> str:
    """The answer to a line that is refused: the number of the error and its sentence in `ERRORS`."""
    return f"ERROR {number} {ERRORS[number]}"


def check_asked(table: Table) -> None:
    """Checks that a table has no pushes: the protocol of `--serve` cannot request them from a robot.

    Raises:
        TableError: the table has pushes; the message names the first node with one.
    """
    if table.pushing is not None:
        raise TableError(
            f"parts are pushed before node {table.pushing}, which a robot that asks does not; "
            'plan with actions.pushes = "none"'
        )


class RefusedError(Exception):
    """Raised to refuse a line of text that the robot sent; the message is the reply to it (`refused`)."""

    def __init__(self, number: int) -> None:
        super().__init__(refused(number))


@dataclass
class _Part:
    """The part that the robot is locating: its pending request, its squeezes so far, its deadline."""

    number: int
    requests: program.Requests
    request: program.Request  # the current one: an `Approach`, or a `Release` that drags
    node: int = 0  # index of the node to squeeze at now, or after the drag
    steps: tuple[Step, ...] = ()
    deadline: float = 0.0


class AskedParts:
    """Answers the protocol lines of one robot by looking up a table, part after part.

    `name` is the digest of the table; the answer to the line `TABLE` states its first digits. The journal
    must already have its header.
    """

    def __init__(
        self,
        table: Table,
        name: str,
        journal: Journal,
        clock: SystemClock,
        console: Console,
        tally: Tally,
        options: RunOptions,
    ) -> None:
        self._table, self._name = table, name
        self._journal, self._clock, self._console, self._tally = journal, clock, console, tally
        self._policy, self._count = options.policy, options.count
        self._calibration = options.handling.widths(table)
        self._middle_mm = options.handling.middle_mm
        self._program = program.Program(table, self._calibration, options.policy)
        self._part: _Part | None = None
        self.over = False  # whether no part follows
        self._readings = {"WIDTH": self._width, "COUNTS": self._counts}
        self._requests: dict[str, Callable[[], str]] = {  # requests of a single word
            "NEXT": self._next,
            "STATUS": self._status,
            "RESET": self._reset,
            "TABLE": self._tell_table,
            "VERSION": lambda: f"VERSION {VERSION} squeezetree",
        }

    @property
    def deadline(self) -> float | None:
        """The clock's time by which the next line is due; None between two parts."""
        return None if self._part is None else self._part.deadline

    def answer(self, line: str) -> str:
        """Returns the answer to a line of the robot; line and answer are without line end.

        Raises:
            JournalError: the journal cannot be written; the line gets no answer, and the run has to end.
        """
        name, *words = line.split(" ")
        try:
            if name in self._readings:
                return self._readings[name](words)
            _check(name in self._requests and not words, 10)
            return self._requests[name]()
        except RefusedError as refusal:
            return str(refusal)

    def give_up(self, outcome: Outcome, reason: str) -> bool:
        """Ends the part under way, if there is one, without a pose; returns whether there was one."""
        if self._part is None:
            return False
        self._end(PartResult.of(self._part.number, outcome, self._part.steps, reason))
        return True

    # -- requests -------------------------------------------------------------------------------------

    def _next(self) -> str:
        part = self._part
        if part is None:
            number = self._tally.parts + 1
            requests = self._program.part(number)
            part = _Part(number, requests, next(requests))
            self._journal.record("part", {"part": number})
            self._part = part
            return self._follow(part)
        _check(isinstance(part.request, program.Release), 12)
        return self._go_on(part)

    def _width(self, words: list[str]) -> str:
        """Takes the width in the line `WIDTH mm [OBJECT|NONE] [node]` as the reading; returns the answer."""
        part, seen = self._due(words, 1)
        _check(NUMBER.fullmatch(words[0]) is not None, 10)
        width_um = round(1000 * float(words[0]))
        room_um = self._table.gripper.noise_um
        _check(-room_um <= width_um <= self._calibration.widest_um + room_um, 20)
        reading_um = self._calibration.nearest_um(width_um)
        if seen is None:
            seen = self._state_of(reading_um, self._program.maps[part.node])
        return self._read(part, program.Reading(reading_um, seen), ["WIDTH", *words])

    def _counts(self, words: list[str]) -> str:
        """Takes the count in the line `COUNTS n OBJECT|NONE [node]` as the reading; returns the answer."""
        part, seen = self._due(words, 2)
        _check(seen is not None and re.fullmatch(r"\d{1,9}", words[0]) is not None, 10)
        assert seen is not None
        profile = self._table.gripper.profile
        _check(profile.counts is not None and int(words[0]) <= MOST_COUNT, 20)
        reading_um = profile.counted_um(int(words[0]))
        return self._read(part, program.Reading(reading_um, seen), ["COUNTS", *words])

    def _status(self) -> str:
        if self._part is None:
            return f"STATUS IDLE {self._tally.parts} 0 -1"
        state = "DRAG" if isinstance(self._part.request, program.Release) else "SQUEEZE"
        return f"STATUS {state} {self._part.number} {len(self._part.steps)} {self._part.node}"

    def _reset(self) -> str:
        self.give_up(Outcome.ABORTED, "the robot gave the part up")
        return "OK"

    def _tell_table(self) -> str:
        limits = self._table.limits
        heights = f"{limits.squeeze_height_um / 1000:.3f} {limits.retreat_height_um / 1000:.3f}"
        sizes = f"{len(self._table.nodes)} {len(self._table.leaves)}"
        return f"TABLE {sizes} {heights} {self._name[:16]}"

    # -- readings -------------------------------------------------------------------------------------

    def _due(self, words: list[str], least: int) -> tuple[_Part, ObjectState | None]:
        """Checks that a reading is due, and that its words are valid.

        Args:
            words: the words after `WIDTH` or `COUNTS`.
            least: the least number of words.

        Returns:
            The current part, and the object state; None if the words do not state it.
        """
        _check(self._part is not None and isinstance(self._part.request, program.Approach), 11)
        assert self._part is not None
        more = words[1:]
        seen = FLAGS[more.pop(0)] if more and more[0] in FLAGS else None
        node = more.pop(0) if more else None
        _check(len(words) >= least and not more and (node is None or node.isdecimal()), 10)
        _check(node is None or node == str(self._part.node), 22)
        return self._part, seen

    def _state_of(self, reading_um: int, decided: DecisionMap) -> ObjectState:
        """Infers the object state from a width alone: the state for which the node has a branch.

        If both states lead to the same decision, a width of at least `HELD_UM` counts as a felt object. If
        they lead to two different branches, the jaws count as empty.
        """
        width_um = self._calibration.width_um(reading_um)
        felt, unfelt = (decide(decided, width_um, felt) for felt in (True, False))
        held = width_um >= HELD_UM if felt == unfelt else unfelt == REJECT
        return ObjectState.CLOSING if held else ObjectState.AT_TARGET

    def _read(self, part: _Part, reading: program.Reading, reply: list[str]) -> str:
        approach = part.request
        assert isinstance(approach, program.Approach)
        self._check_possible(approach, reading)
        self._console.phase(part.number, Phase.READ, approach.index)
        release = program.released(part.requests, approach, reading)
        stated = {"object_flag": int(reading.object), "reply": " ".join(reply)}
        fields = {**release.step.fields(), **stated}
        self._journal.record("squeeze", {"part": part.number, **fields})
        part.request, part.steps, part.node = release, release.steps, release.after.node
        self._console.step(part.number, release.step)
        if release.point is None:
            return self._go_on(part)
        self._console.phase(part.number, Phase.RELEASE, release.index)
        x_mm, y_mm, _ = sent(placement(release.node.squeeze, release.point), self._middle_mm)
        return f"DRAG {x_mm:.3f} {y_mm:.3f}"

    def _check_possible(self, approach: program.Approach, reading: program.Reading) -> None:
        """Refuses an impossible reading with one of two errors of `ERRORS`.

        Error 23: the jaws report that they closed on nothing, but are open. Error 21: the jaws are as wide
        open as before the squeeze, and the node has no branch for that width.

        Raises:
            RefusedError: the reading is impossible.
        """
        calibration, decided = self._calibration, self._program.maps[approach.index]
        reading_um, seen = reading
        try:
            check_closed(Settled(reading_um, seen, 0, 0, 0.0), calibration, (0, 0))
        except GripperStateError:
            raise RefusedError(23) from None
        opened_um = min(approach.node.squeeze.opening_um, calibration.widest_um)
        closed = calibration.width_um(reading_um + room_um(calibration.profile)) < opened_um
        width_um = calibration.width_um(reading_um)
        _check(closed or decide(decided, width_um, seen is ObjectState.CLOSING) != REJECT, 21)

    # -- what follows ---------------------------------------------------------------------------------

    def _go_on(self, part: _Part) -> str:
        """Goes on to the program's next request after a release; returns the answer that states it."""
        part.request = next(part.requests)
        return self._follow(part)

    def _follow(self, part: _Part) -> str:
        """Journals the current request: a squeeze, or the part's end. Returns the answer that states it."""
        request = part.request
        if isinstance(request, program.Done):
            self._end(request.result)
            return self._ended(request.result)
        assert isinstance(request, program.Approach)
        squeeze = request.node.squeeze
        fields = {"part": part.number, "number": request.number, "node": request.index}
        self._journal.record("placed", fields)
        self._console.phase(part.number, Phase.PLACE, request.index)
        expected = expected_of(self._table, request.node, SLOWEST_UM_S)
        part.deadline = self._clock.deadline(DEADLINE_FACTOR * expected.total_s)
        x_mm, y_mm, angle_rad = sent(placement(squeeze), self._middle_mm)
        return (
            f"SQUEEZE {request.index} {x_mm:.3f} {y_mm:.3f} {degrees(angle_rad):.5f} "
            f"{squeeze.opening_um / 1000:.3f} {squeeze.speed_um_s / 1000:.1f} {squeeze.force_mn / 1000:.1f}"
        )

    def _ended(self, result: PartResult) -> str:
        if result.outcome is Outcome.REJECT or result.leaf is None:
            return f"REJECT {str(result.reason).partition(' (')[0]}"
        if result.outcome is Outcome.UNRESOLVED:
            return f"UNRESOLVED {result.leaf}"
        leaf = self._table.leaves[result.leaf]
        success = UNTRIED if leaf.success is None else leaf.success
        pose = f"{leaf.x_um / 1000:.3f} {leaf.y_um / 1000:.3f} {degrees(leaf.theta_urad / 1e6):.5f}"
        name = self._table.name_of(leaf)
        named = "" if name is None else f" {leaf.hypothesis} {_plain(name)}"
        return f"LEAF {result.leaf} {pose} {success:.6f}{named}"

    def _end(self, result: PartResult) -> None:
        self._journal.record("outcome", outcome_fields(self._table, result))
        self._part = None
        self._console.phase(result.part, Phase.DONE, None)
        self._tally.add(result, None)
        self._console.part(result, None)
        outcome = result.outcome
        ends = outcome is not Outcome.ABORTED and self._policy.ends_run(outcome)
        self.over = ends or self._tally.parts == self._count


def _plain(name: str) -> str:
    """A part's name in ASCII, truncated to `MAX_NAME` characters."""
    return cleaned(name).encode("ascii", "replace").decode()[:MAX_NAME]


def _check(holds: bool, number: int) -> None:
    if not holds:
        raise RefusedError(number)
