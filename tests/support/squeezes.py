"""Runs parts on a fake cell whose jaws stop at given widths, and lists the commands to jaws and arm."""

from counting import SETTINGS, count_of
from fake_cell import Deaf, FakeCell, State, fake_cell
from sample_tables import small_table

from runtime.execution.executor import Executor, RunOptions
from runtime.execution.tips import TipArc
from runtime.table import Table
from runtime.traversal.results import PartResult

CONTACT, ARRIVED = 2, 3
WIDTHS = (21_000, 30_000, 36_000, 60_000)
AT_21, AT_30, AT_36, AT_60 = ((count_of(width), CONTACT) for width in WIDTHS)
EMPTY = (229, ARRIVED)
CLOSED = (229, CONTACT)  # the jaws hold something thinner than a count
ARC = TipArc()


def run(
    rig: FakeCell, options: RunOptions, table: Table | None = None, phases: list | None = None
) -> PartResult:
    console, seen = Deaf(), [] if phases is None else phases
    console.phase = lambda part, phase, node: seen.append((phase, node))
    return Executor(table or small_table(), rig.cell, console, options).run_part(1)


def meeting(stop: int) -> FakeCell:
    """Returns a fake cell with a part, on which the jaws stop at the count `stop`.

    A command to close less far does not reach the part, and the jaws stop where the command says.
    """
    rig = fake_cell([])

    def meet(width_um: int, speed_mm_s: float, force_n: float) -> None:
        asked = SETTINGS.request(width_um)
        settings = SETTINGS.speed(speed_mm_s), SETTINGS.force(force_n)
        rig.log.call("gripper", "move", asked, *settings)
        count, flag = (stop, CONTACT) if asked > stop else (max(asked, 3), ARRIVED)
        rig.gripper.now = State(object_flag=flag, echo_counts=asked, position_counts=count)

    rig.gripper.move = meet
    return rig


def jaw_moves(rig: FakeCell) -> list[tuple]:
    return [call.arguments for call in rig.log.named("move")]


def arm_moves(rig: FakeCell) -> list[tuple]:
    return [call.arguments for call in rig.log.named("move_linear")]
