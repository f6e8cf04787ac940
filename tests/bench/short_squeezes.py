"""Prints the seconds a part with and without each measure that saves time, in the simulated cell.

    python tests/bench/short_squeezes.py trees/rectangle/rectangle.msgpack --parts 100

Seconds are those of virtual time. Beside them stands what the model of time gives for the same squeezes. A
measure is switched off by patching the code. With several tables it prints one row for each table: the
seconds with all measures and without any.
"""

import statistics
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import harness

from drivers.abb.codec import Reply
from drivers.ports import TURN_RADIUS_MM
from drivers.robotiq import gripper as driver
from drivers.sim.physics.scene import load
from drivers.sim.virtual.cell import VirtualCell
from runtime.execution.events import Console
from runtime.execution.executor import Cell, Executor, RunOptions
from runtime.execution.hand import Hand, Handling
from runtime.execution.jaws import Jaws
from runtime.table import Schedule, Squeezed, Table, Timing, job_of
from runtime.table import load as load_table


class Nowhere:
    """A journal that keeps no record."""

    def record(self, kind: str, fields: object) -> None:
        """Drops the record."""


def _sequential(hand: Hand, squeeze, following) -> None:
    """Replaces `Hand.let_go`: opens at the squeeze's speed, as far as the next squeeze needs, and waits."""
    hand.where()
    wide = max(squeeze, following, key=lambda ours: ours.opening_um)
    hand.jaws.open_to(squeeze, wide.opening_um / 1000)


def _tightened(meet: Callable, tighten: Callable) -> Callable:
    return lambda hand, node: tighten(hand, node, meet(hand, node))


def _slow_looks(move: Callable) -> Callable:
    def moved(gripper, *settings) -> None:
        move(gripper, *settings)
        gripper._move = replace(gripper._move, pause_s=0.02)

    return moved


# Each measure, and what is put in which place to switch it off.
OFF: dict[str, list[tuple[type, str, object]]] = {
    "arm and jaws at once, jaws fast once free": [(Hand, "let_go", _sequential)],
    "no second opening": [(Jaws, "_stands_open", lambda *_: False)],
    "settled: three equal readings as fast as the count may change": [
        (driver.Gripper, "move", _slow_looks(driver.Gripper.move))
    ],
    "the arm's answers: read as soon as they are whole": [
        (Reply, "ended", property(lambda reply: not reply.fields))
    ],
    "force raised only where it changes anything": [
        (Hand, "meet", _tightened(Hand.meet, Hand.tighten)),
        (Hand, "tighten", lambda _, __, reading: reading),
    ],
    "come down on the way to the first squeeze": [(Timing, "comes_down", lambda *_: False)],
    "begin a part at the angle at which the hand stands": [(Hand, "turn_of_plan", lambda *_: 0.0)],
}
REGRASP, RADIUS = "rise to the regrasp height", "turn as fast as the gripper's reach allows"
SHORT_WAY, CONTACT = "turn the short way", "close fast until shortly before contact"
OPENING = "open only as wide as the squeeze needs"
MEASURES = (CONTACT, OPENING, REGRASP, RADIUS, SHORT_WAY, *OFF)


def seconds(table: Table, tree: Path, parts: int, without: set[str]) -> list[tuple[float, float]]:
    """Runs parts without some measures; returns the measured and the modelled seconds of each part.

    The first part is left out, since it begins wherever the arm stood.
    """
    if CONTACT in without:
        table = replace(table, nodes=tuple(node._replace(contact_um=None) for node in table.nodes))
    if OPENING in without:
        table = replace(table, nodes=tuple(_wide(node, table) for node in table.nodes))
    setting = load(tree, None, None)
    if RADIUS in without:
        geometry = setting.geometry._replace(turn_radius_mm=TURN_RADIUS_MM)
        setting = setting._replace(geometry=geometry)
    with ExitStack() as stack:
        for name in OFF.keys() & without:
            for place in OFF[name]:
                stack.enter_context(patch.object(*place))
        cell = VirtualCell(setting, 1)
        gripper = cell.gripper()
        gripper.activate()
        options = RunOptions(handling=Handling(regulated=True))
        devices = Cell(gripper, cell.arm(), cell.clock, Nowhere())
        executor = Executor(table, devices, Console(), options)
        hand = executor._hand
        if REGRASP in without:
            hand.timing = replace(hand.timing, regrasp_mm=hand.timing.retreat_mm)
        if RADIUS in without:
            hand.timing = replace(hand.timing, turn_radius_mm=TURN_RADIUS_MM)
        if SHORT_WAY in without:
            hand._half_turn = 2.0 * hand._half_turn
        return list(_run(table, cell, executor, parts))


def _wide(node, table: Table):
    """The node, with its jaws fully open before the squeeze."""
    return node._replace(squeeze=node.squeeze._replace(opening_um=table.gripper.opening_um))


def _run(table: Table, cell: VirtualCell, executor: Executor, parts: int):
    schedule, before = Schedule.of(table, job_of(table)), None
    for number in range(parts):
        result = executor.run_part(cell.scene.next_part())
        assert result.seconds is not None, result.reason
        built = [
            Squeezed(step.node, step.width_um / 1e3, _branch(table, step.node, step.target))
            for step in result.steps
        ]
        record = sum(phases.total_s for phases in schedule.part(built, before))
        before = schedule.squeeze(built[-1], None, None, first=True)[1]
        if number:  # the first begins wherever the arm stood
            yield result.seconds, record


def _branch(table: Table, node: int, target: int | None) -> int:
    targets = [branch.target for branch in table.nodes[node].branches]
    return targets.index(target) if target in targets else -1


def main() -> None:
    """Prints a row for each measure of one table, or a row for each of several tables."""
    parser = harness.parser(__doc__)
    parser.add_argument("trees", type=Path, nargs="+", metavar="TREE.msgpack")
    parser.add_argument("--parts", type=int, default=100)
    given = parser.parse_args()
    if len(given.trees) > 1:
        _tables(given.trees, given.parts)
    else:
        _measures(given.trees[0], given.parts)


def _tables(trees: list[Path], parts: int) -> None:
    print(f"{parts} parts; seconds a part: mean (95th percentile)")
    print(f"{'table':20s} all measures    none of them   share")
    means = []
    for tree in trees:
        table = load_table(tree).table
        runs = [seconds(table, tree, parts, without) for without in (set(), set(MEASURES))]
        means.append([_mean(run) for run in runs])
        texts = "  ".join(_text([real for real, _ in run]) for run in runs)
        print(f"{tree.stem:20s} {texts}  {means[-1][0] / means[-1][1]:6.1%}", flush=True)
    whole, none = map(statistics.fmean, zip(*means, strict=True))
    print(
        f"{'mean of the tables':20s} {whole:6.2f}          {none:6.2f}         {whole / none:6.1%}"
    )


def _measures(tree: Path, parts: int) -> None:
    table = load_table(tree).table
    print(f"{tree.name}, {parts} parts; seconds a part: mean (95th percentile)")
    whole = seconds(table, tree, parts, set())
    none = seconds(table, tree, parts, set(MEASURES))
    print(f"{'all measures':64s} {_text([real for real, _ in whole])}")
    print(f"{'forecast of the same squeezes':64s} {_text([record for _, record in whole])}")
    print(f"{'none of them':64s} {_text([real for real, _ in none])}")
    print(f"{'measure':64s} alone saves   without it more")
    for name in MEASURES:
        alone = seconds(table, tree, parts, set(MEASURES) - {name})
        rest = seconds(table, tree, parts, {name})
        print(
            f"{name:64s} {_mean(none) - _mean(alone):11.2f}   {_mean(rest) - _mean(whole):15.2f}",
            flush=True,
        )


def _mean(rows: list[tuple[float, float]]) -> float:
    return statistics.fmean(real for real, _ in rows)


def _text(values: list[float]) -> str:
    return f"{statistics.fmean(values):6.2f} ({sorted(values)[int(0.95 * len(values))]:.2f})"


if __name__ == "__main__":
    main()
