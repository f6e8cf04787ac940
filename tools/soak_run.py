"""Simulates one run of `tools/soak`: the runtime operates a virtual cell, and every step is checked."""

import base64
import hashlib
import json
import math
import random
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.dh import registers as dh
from drivers.ports import Gripper, Report
from drivers.schunk import registers as schunk
from drivers.sim import grippers
from drivers.sim.faults import SCENE_KINDS, Listed, Seeded
from drivers.sim.physics.scene import Setting
from drivers.sim.virtual.cell import VirtualCell
from drivers.sim.virtual.clock import VirtualClock
from runtime.execution.delivery import Delivery
from runtime.execution.events import Console, Phase
from runtime.execution.executor import Cell, Executor, RunOptions
from runtime.execution.handling import Handling
from runtime.execution.session import sight
from runtime.execution.watch import DEADLINE_FACTOR, expected_of
from runtime.journal.replay import Replay
from runtime.shell.errors import is_expected
from runtime.table import PPM, Table, dumps
from runtime.traversal.decision import Policy
from runtime.traversal.results import Outcome, PartResult

FRESH_S = 0.5  # age above which a reading of the gripper no longer justifies a motion
GOES, RESET_FAULTS = 0x08, 0x0A
SAME_MM = 0.5
SUMMED = (
    *("parts", "squeezes", "transactions", "crashes", "delivered"),
    "halts",  # halts of the arm's controller
    "leaves_outside_goal",  # parts that a leaf states wrongly, by more than the goal
    "predicted_outside",  # the number of such parts that the success rates of the leaves predict
    "simulated_s",
)
WATCHDOG_S = 90.0  # tools/systemd/squeezetree@.service
# Time allowed for a squeeze beyond the executor's deadline, and for a part beyond its squeezes.
SQUEEZE_S, PART_S = 30.0, 60.0

# Faults that displace part or arm, or falsify readings, so that fingers may come down on a part.
MOVED = {
    *(kind.name for kind in SCENE_KINDS),
    *("count_frozen", "count_spike", "encoder_offset", "grip_lost", "arm_displaced", "arm_turned"),
}

# Options of which each run draws one; the first are the defaults of grasp-runtime.
REGULATED = Handling(regulated=True)
HANDLED = (
    RunOptions(handling=REGULATED),
    RunOptions(),
    RunOptions(Policy.of("resqueeze,restart,next", "restart,next"), REGULATED),
    RunOptions(Policy.of("restart,next", "next")),
    RunOptions(Policy.of("resqueeze,next", "next"), REGULATED, Delivery(drop=(20.0, -15.0, 0.7))),
)


@dataclass
class Watch:
    """Observes commands to gripper and arm; records as a finding each command without a recent reading."""

    cell: VirtualCell | None = None
    read_s: float = -math.inf  # time of the last reading; -inf after a command to the jaws
    ready: bool = False  # whether the gripper was ready at that reading
    at_mm: tuple[float, ...] = (math.nan, math.nan, math.inf)  # last target of the arm
    wrist_deg: tuple[float, float] = (math.inf, -math.inf)  # least and greatest angle
    findings: list[str] = field(default_factory=list)

    def now(self) -> float:
        """Simulated time [s]; 0 before there is a cell."""
        return self.cell.clock.now() if self.cell else 0.0

    def read(self, *, ready: bool) -> None:
        """Records that the gripper was read, and whether it was ready."""
        self.read_s, self.ready = self.now(), ready

    def go(self, target: int) -> None:
        """Checks a command to the jaws: the gripper must have been read before, and be ready."""
        if self.now() - self.read_s > FRESH_S:
            self.findings.append(
                f"jaws told to go to {target} without a look since the last command"
            )
        elif not self.ready:
            self.findings.append(f"jaws told to go to {target} though not ready")
        self.read_s = -math.inf

    def overheard(self, text: str) -> None:
        """Checks an instruction to the arm; instructions other than motions are ignored."""
        if not text.startswith("1 "):
            return
        target = tuple(float(word) for word in text.split(" ")[1:4])
        self.look_at_wrist()
        if self.cell and self.cell.works.arm.halted:
            self.findings.append("a silent arm was told to move")
        if not self._is_retreat(target) and self.now() - self.read_s > FRESH_S:
            self.findings.append("the arm was told to move without a look at the gripper")
        self.at_mm = target

    def look_at_wrist(self) -> None:
        """Widens the range `wrist_deg`, so that it contains the true angle of the arm's last axis."""
        if self.cell is not None:
            angle = self.cell.works.arm.joints_at(self.cell.clock.now())[5]
            self.wrist_deg = (min(self.wrist_deg[0], angle), max(self.wrist_deg[1], angle))

    def _is_retreat(self, target: tuple[float, ...]) -> bool:
        """Whether a motion goes straight up: the safe sequence does so without reading the gripper."""
        return math.dist(target[:2], self.at_mm[:2]) <= SAME_MM and target[2] >= self.at_mm[2]


class Pulse(Console):
    """Measures the longest time between two phases of a run, which a service manager's watchdog must allow.

    The service manager is notified at phases only.
    """

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self._last_s = clock.now()
        self.longest_s = 0.0

    def phase(self, part: int, phase: Phase, node: int | None) -> None:
        now_s = self._clock.now()
        self.longest_s = max(self.longest_s, now_s - self._last_s)
        self._last_s = now_s


class WatchedLink:
    """A Robotiq gripper's link that counts its transactions, and reports them to a `Watch`."""

    def __init__(self, link: Any, watch: Watch) -> None:
        self.endpoint, self.close, self.transactions = link.endpoint, link.close, 0
        self._link, self._watch = link, watch

    def read(self, *what: str) -> Any:
        self.transactions += 1
        answer = self._link.read(*what)
        ready = self.ready(answer, *what)
        if ready is not None:
            self._watch.read(ready=ready)
        return answer

    def write(self, *what: Any) -> None:
        self.transactions += 1
        target = self.target(*what)
        if target is not None:
            self._watch.go(target)
        self._link.write(*what)

    def ready(self, block: bytes) -> bool | None:
        """Whether the gripper may move, according to an answer; None if the answer does not say this."""
        return block[0] & 0x31 == 0x31 and block[2] & 0x0F < RESET_FAULTS

    def target(self, block: bytes) -> int | None:
        """The target to which a write moves the jaws, in the gripper's units; None if it moves nothing."""
        return block[3] if block[0] & GOES else None


class WatchedDh(WatchedLink):
    """Watched link of a DH gripper."""

    def ready(self, words: Mapping[int, int]) -> bool:
        return words[dh.INITIALISED] == dh.Initialised.YES

    def target(self, register: int, value: int) -> int | None:
        return value if register == dh.POSITION else None


class WatchedSchunk(WatchedLink):
    """Watched link of a SCHUNK gripper."""

    _last: tuple[float, ...] = ()

    def ready(self, values: tuple[float, ...], name: str) -> bool | None:
        return bool(int(values[0]) & schunk.Status.READY) if name == "plc_sync_input" else None

    def target(self, name: str, *values: float) -> int | None:
        repeated, self._last = values == self._last, values
        moves = name == "plc_sync_output" and int(values[0]) & schunk.Control.MOTIONS
        return int(values[1]) if moves and not repeated else None


def watched(cell: VirtualCell, watch: Watch, report: Report) -> tuple[Gripper, WatchedLink]:
    """Returns the driver of the cell's gripper, and its watched link."""
    simulator, pace = cell.works.simulator, cell.pace
    kinds = {id(grippers.DH): WatchedDh, id(grippers.SCHUNK): WatchedSchunk}
    kind = kinds.get(id(simulator), WatchedLink)
    link = kind(simulator.link(cell.serial(), pace, report), watch)
    return simulator.gripper(link, pace, report, cell.works.profile), link


class Records:
    """A journal that keeps only the digest of its records; a replay checks each record as it is written."""

    def __init__(self, table: Table, plan: RunOptions) -> None:
        self.digest = hashlib.sha256()
        self.findings: list[str] = []
        self._replay = Replay()
        self._seq = 0
        header = {"table_base64": base64.b64encode(dumps(table)).decode("ascii")}
        self.record("header", {**header, **plan.policy.fields()})

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        self.digest.update(json.dumps([kind, fields], sort_keys=True).encode())
        entry = {"seq": self._seq, "kind": kind, **fields}
        self._seq += 1
        wrong = self._replay.follow([entry])
        self.findings += [f"record {each.seq}: {each.sentence}" for each in wrong]


@dataclass
class Counts:
    """Results of one run, or their sums over many: counts, extremes and findings."""

    seed: int
    sums: Counter[str] = field(default_factory=Counter)  # sums of the quantities `SUMMED`
    wrist_deg: tuple[float, float] = (math.inf, -math.inf)  # least and greatest angle of the wrist
    silent_s: float = 0.0  # longest time without a notification of the watchdog
    outcomes: Counter[str] = field(default_factory=Counter)  # parts by outcome
    met: Counter[str] = field(default_factory=Counter)  # injected faults by kind
    findings: list[str] = field(default_factory=list)
    digest: str = ""  # digest of all records of the journal
    last: PartResult | None = None  # result of the last part


@dataclass(frozen=True)
class Soak:
    """Setting, table and options of a soak test; each run draws one of the options `handled`."""

    setting: Setting
    table: Table
    faults: bool
    parts: int
    handled: tuple[RunOptions, ...] = HANDLED

    def plan(self, seed: int) -> RunOptions:
        """Draws the options with which a run handles parts, by the seed of the run."""
        return random.Random(f"{seed}/plan").choice(self.handled)

    def squeeze_s(self) -> float:
        """Longest time that a squeeze may take, s."""
        return DEADLINE_FACTOR * expected_of(self.table, self.table.nodes[0]).total_s + SQUEEZE_S


def run(soak: Soak, seed: int, faults: Listed | None = None) -> Counts:
    """Simulates one cell until a part ends in a fault or all parts are done; returns the results.

    `faults`, if given, are injected instead of random ones.
    """
    plan = soak.plan(seed)
    watch, records, counts = Watch(), Records(soak.table, plan), Counts(seed)
    faults = faults or (Seeded(seed) if soak.faults else None)
    watch.cell = cell = VirtualCell(soak.setting, seed, faults, watch.overheard)
    try:
        gripper, link = watched(cell, watch, records.record)
        gripper.activate()
        arm = cell.arm()
    except (OSError, RuntimeError) as error:  # a fault met while connecting: nothing has moved
        counts.outcomes["not connected"] += 1
        counts.findings += [] if is_expected(error) else [f"connecting: {error!r}"]
        counts.met.update(cell.works.desk.met)
        return counts
    pulse = Pulse(cell.clock)
    executor = Executor(soak.table, Cell(gripper, arm, cell.clock, records), pulse, plan)
    for _ in range(soak.parts):
        if _run_part(soak, cell, executor, counts) is Outcome.FAULT:
            break
    if not soak.faults and (counts.outcomes["fault"] or counts.sums["crashes"]):
        crashes = counts.sums["crashes"]
        counts.findings.append(
            f"without faults: {counts.outcomes['fault']} faults, {crashes} crashes"
        )
    if pulse.longest_s > WATCHDOG_S:
        counts.findings.append(f"the watchdog was not fed for {pulse.longest_s:.0f} s")
    counts.silent_s = pulse.longest_s
    counts.met.update(cell.works.desk.met)
    watch.look_at_wrist()
    counts.wrist_deg = watch.wrist_deg
    counts.sums["transactions"] += link.transactions
    counts.sums["halts"] += bool(cell.works.arm.halted)
    counts.sums["simulated_s"] += cell.clock.now()
    counts.findings += watch.findings + records.findings
    counts.digest = records.digest.hexdigest()
    return counts


def _run_part(soak: Soak, cell: VirtualCell, executor: Executor, counts: Counts) -> Outcome:
    """Runs one part, adds its result and its findings to `counts`, and returns its outcome."""
    before = len(cell.works.desk.met)
    part = cell.scene.next_part()
    began = cell.clock.now()
    result = executor.run_part(part)
    _count(soak.table, cell, result, counts)
    if cell.scene.truth().crashes and not MOVED & set(cell.works.desk.met[before:]):
        counts.findings.append(
            f"part {part}: open fingers came down on a part that nothing had moved"
        )
    counts.findings += _judge(soak, part, result, cell.clock.now() - began)
    return result.outcome


def _count(table: Table, cell: VirtualCell, result: PartResult, counts: Counts) -> None:
    """Adds a part to `counts`.

    Two sums compare the parts outside the goal with the prediction. They grow if the part ends at a leaf, has
    a known true pose, and no delivery was tried. Then `leaves_outside_goal` grows by 1 if the part is outside
    the goal, and `predicted_outside` by the failure rate of the leaf.
    """
    truth = cell.scene.truth()
    delivered = result.delivery == "done"
    squeezes = len(result.steps)
    counts.sums.update(parts=1, squeezes=squeezes, crashes=truth.crashes, delivered=delivered)
    counts.outcomes[result.outcome.value] += 1
    counts.last = result
    if result.outcome is not Outcome.LEAF or math.isnan(truth.x_mm) or result.delivery is not None:
        return
    counts.sums["leaves_outside_goal"] += sight(table, cell.scene, result).within is False
    counts.sums["predicted_outside"] += 1.0 - table.leaves[result.leaf or 0].success_ppm / PPM


def _judge(soak: Soak, part: int, result: PartResult, seconds: float) -> list[str]:
    """The findings about a finished part: too late, or in a fault without the safe sequence."""
    findings = []
    squeezes = len(result.steps) + (1 if result.delivery is None else 3)
    if seconds > (limit := squeezes * soak.squeeze_s() + PART_S):
        findings.append(f"part {part} took {seconds:.0f} s, allowed were {limit:.0f}")
    if result.outcome is Outcome.FAULT and not result.safe_state:
        findings.append(f"part {part} ended in a fault without the safe sequence")
    return findings
