"""What the fingers may hold at the start of a run, and how it is put down; on a cell in memory."""

import pytest
from counting import CALIBRATION, count_of, width_um
from fake_cell import FakeCell, Log, State, fake_cell
from sample_tables import small_table
from squeezes import arm_moves

from runtime.errors import GripperStateError, MotionRefusedError
from runtime.execution import held, session
from runtime.execution.delivery import Delivery
from runtime.execution.executor import RunOptions
from runtime.execution.handling import Handling
from runtime.execution.tips import TipArc
from runtime.table import Area

AT_30 = count_of(30_000)
HOLDING = State(object_flag=2, echo_counts=255, position_counts=AT_30)


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (State(), None),  # wide open, as after a run
        (State(echo_counts=0, position_counts=13), None),  # the open end of some grippers
        (State(echo_counts=60, position_counts=62), None),  # opened as wide as a node wants it
        (State(echo_counts=255, position_counts=228), None),  # closed on nothing
        (HOLDING, "hold something: they met it"),
        (HOLDING._replace(position_counts=8), "hold something: they met it"),  # as wide as the jaws
        (HOLDING._replace(object_flag=0), "may hold something: they were stopped"),
        (HOLDING._replace(object_flag=3), "they were stopped"),  # thin, or a stale flag
        (HOLDING._replace(object_flag=0, echo_counts=0), "may hold something: they were stopped"),
        (HOLDING._replace(activated=False, echo_counts=0), "may hold something: the gripper is"),
        (State(activated=False, object_flag=0), None),
    ],
)
def test_look_reports_what_fingers_may_hold(state, message):
    holds = held.look(state.reading, CALIBRATION)
    assert (holds is None) == (message is None)
    if holds is not None:
        assert message in holds.sentence()
        assert f"{width_um(state.position_counts) / 1000:.2f} mm" in holds.sentence()


def holding(log: Log | None = None) -> FakeCell:
    rig = fake_cell([], log)
    rig.gripper.now, rig.arm.at = HOLDING, (50.0, 5.0, 60.0, 0.1)
    return rig


def heights(rig: FakeCell) -> list[float]:
    return [target[2] for target in arm_moves(rig)]


def test_put_down_lowers_in_place_before_opening():
    rig = holding()
    session.put_down(small_table(), rig.cell, RunOptions())
    moves = [call.name for call in rig.log.calls if call.name in ("move_linear", "move")]
    assert moves == ["move_linear", "move", "move_linear"]
    assert heights(rig) == [10.0, 60.0]
    assert rig.arm.at[:2] == (50.0, 5.0)
    assert 33_000 < width_um(rig.gripper.now.position_counts) < 37_000
    assert rig.journal.kinds() == ["put_down", "put_down", "end"]
    assert rig.journal.kept[-1][1]["exit_code"] == 0


def test_put_down_with_tip_arc_stops_higher_by_its_advance():
    rig, arc = holding(), TipArc(level_mm=8.0)
    session.put_down(small_table(), rig.cell, RunOptions(handling=Handling(arc=arc)))
    assert heights(rig)[0] == pytest.approx(10.0 + arc.advance_mm(width_um(AT_30) / 1000), abs=0.01)


def test_put_down_outside_work_area_needs_area_of_delivery():
    rig = holding()
    rig.arm.at = (80.0, 5.0, 60.0, 0.1)
    with pytest.raises(MotionRefusedError, match="outside the work area"):
        session.put_down(small_table(), rig.cell, RunOptions())
    assert rig.log.named("move") == []
    carried = Delivery((0.0, 0.0, 0.0), area_um=Area(-60_000, -60_000, 90_000, 60_000))
    session.put_down(small_table(), rig.cell, RunOptions(delivery=carried))
    assert rig.arm.at == (80.0, 5.0, 60.0, 0.1)


def test_put_down_any_failure_ends_in_safe_state_and_is_recorded():
    whole = holding()
    session.put_down(small_table(), whole.cell, RunOptions())
    for number in range(len(whole.log.calls)):
        rig = holding(Log(number, GripperStateError("something")))
        with pytest.raises(GripperStateError, match="something") as failed:
            session.put_down(small_table(), rig.cell, RunOptions())
        assert failed.value.__notes__[0].startswith("fingers")
        assert rig.log.named("stop")
        opened = rig.gripper.now.position_counts < HOLDING.position_counts
        untouched = max(heights(rig), default=10.0) == 10.0
        assert opened or untouched, "a part that may be fixed is never lifted"
        assert rig.journal.kept[-1][1]["exit_code"] == 20
