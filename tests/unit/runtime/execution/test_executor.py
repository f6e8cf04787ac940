"""The executor: outcomes, the order of motions, and a safe end whichever call fails."""

import pytest
from counting import count_of
from fake_cell import Deaf, FakeCell, FakeJournal, Log, State, fake_cell
from sample_tables import changed, pushing_table, random_table, small_table
from squeezes import ARRIVED, AT_21, AT_30, AT_36, CONTACT

from drivers.errors import ArmError, GripperFault, LinkError
from runtime.errors import JournalError, TableError
from runtime.execution.executor import Executor, RunOptions
from runtime.table import Table
from runtime.traversal.decision import Policy
from runtime.traversal.results import Outcome, PartResult, Step

LONGEST = [AT_30, AT_21]  # reaches leaf 1 by both nodes


class ForeignError(Exception):
    """An error of a foreign library that has an attribute `exit_code`, as the project's errors do."""

    exit_code = 21


def run(rig: FakeCell, table: Table | None = None, seen: list[Step] | None = None) -> PartResult:
    console = Deaf()
    console.step = lambda part, step: None if seen is None else seen.append(step)
    return Executor(table or small_table(), rig.cell, console).run_part(1)


def motions(rig: FakeCell) -> list[tuple]:
    """The targets of all motions of jaws and arm, in the order of the motions."""
    sent = {
        "move": lambda call: ("jaws", call.arguments[0]),
        "move_linear": lambda call: call.arguments,
    }
    return [sent[call.name](call) for call in rig.log.calls if call.name in sent]


def number_of_calls(table: Table) -> int:
    rig = fake_cell(LONGEST)
    run(rig, table)
    return len(rig.log.calls)


CALLS = [
    pytest.param(table, at, id=f"{name}-{at}")
    for name, table in (("squeezes", small_table()), ("pushes", pushing_table()))
    for at in range(number_of_calls(table))
]


@pytest.mark.parametrize(
    ("counts", "outcome", "leaf", "path", "exit_code"),
    [
        ([AT_21], Outcome.LEAF, 0, [0], 0),
        ([AT_30, AT_21], Outcome.LEAF, 1, [0, 1], 0),
        ([AT_30, AT_36], Outcome.UNRESOLVED, 2, [0, 1], 10),
        ([AT_36], Outcome.REJECT, None, [0], 10),
        ([AT_30, AT_30], Outcome.REJECT, None, [0, 1], 10),
        ([(229, ARRIVED)], Outcome.REJECT, None, [0], 10),
    ],
)
def test_executor_outcome_follows_widths(counts, outcome, leaf, path, exit_code):
    rig, seen = fake_cell(counts), []
    result = run(rig, seen=seen)
    assert (result.outcome, result.leaf, result.exit_code) == (outcome, leaf, exit_code)
    assert [step.node for step in result.steps] == path
    assert list(result.steps) == seen
    assert (result.reason is None) == (outcome is Outcome.LEAF)
    assert result.safe_state == ()
    assert rig.journal.kinds() == ["part", *["placed", "squeeze"] * len(path), "outcome"]


def test_executor_motions_are_place_open_descend_close_open_retreat():
    rig = fake_cell(LONGEST)
    run(rig)
    lines = [motion if motion[0] == "jaws" else motion[:4] for motion in motions(rig)]
    one = [("jaws", 0), (0.0, 0.0, 60.0, 0.0), (0.0, 0.0, 10.0, 0.0), ("jaws", 255), ("jaws", 0)]
    two = [(1.0, -2.0, 60.0, 1.570796), (1.0, -2.0, 10.0, 1.570796), ("jaws", 255), ("jaws", 0)]
    up = (5.0, 5.0, 60.0, 0.1)  # straight, from wherever it stood
    assert lines == [up, *one, (0.0, 0.0, 60.0, 0.0), *two, (1.0, -2.0, 60.0, 1.570796)]


def test_executor_push_sets_jaws_and_moves_along_x_of_hand():
    rig = fake_cell(LONGEST)
    result = run(rig, pushing_table())
    assert (result.outcome, result.leaf) == (Outcome.LEAF, 1)
    lines = motions(rig)
    first = [
        (5.0, 5.0, 60.0, 0.1, 400.0),
        ("jaws", 230),
        (-50.0, 1.0, 60.0, 0.0, 400.0),
        (-50.0, 1.0, 10.0, 0.0, 400.0),
        (-20.0, 1.0, 10.0, 0.0, 30.0),
        (-20.0, 1.0, 60.0, 0.0, 400.0),
        ("jaws", 0),
    ]
    assert lines[: len(first)] == first
    low = [motion for motion in lines if motion[0] != "jaws" and motion[2] == 10.0]
    third_push = low[6]
    assert third_push == pytest.approx((3.0, 25.0, 10.0, -1.570796, 30.0), abs=1e-4)
    pushed = ["pushing", "placed", "squeeze", "pushing", "pushing", "placed", "squeeze"]
    assert rig.journal.kinds() == ["part", *pushed, "outcome"]


def test_executor_pushes_again_on_restart_but_not_on_resqueeze():
    rig = fake_cell([AT_36, AT_36, AT_21])
    options = RunOptions(Policy.of("resqueeze,restart,next", "next"))
    result = Executor(pushing_table(), rig.cell, Deaf(), options).run_part(1)
    assert (result.outcome, result.leaf) == (Outcome.LEAF, 0)
    kinds = "part pushing placed squeeze placed squeeze pushing placed squeeze outcome"
    assert rig.journal.kinds() == kinds.split()


def test_executor_push_with_displaced_jaws_is_fault():
    rig = fake_cell(LONGEST)
    slide = rig.arm.move_linear

    def bend(target, speed_mm_s, *radius):
        slide(target, speed_mm_s, *radius)
        if speed_mm_s == 30.0:
            rig.gripper.now = rig.gripper.now._replace(position_counts=220)

    rig.arm.move_linear = bend
    result = run(rig, pushing_table())
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, 20)
    assert "the jaws stand at 3.74 mm and were set to 0.00 mm to push" in str(result.reason)
    assert rig.arm.at[2] == 60.0


@pytest.mark.parametrize("seed", range(2))
def test_executor_descends_only_open_and_moves_below_caps(seed):
    table = random_table(seed, 15)
    rig = fake_cell([(count_of(b.expected_um), CONTACT) for b in _first_path(table)])
    result = run(rig, table)
    assert result.outcome in (Outcome.LEAF, Outcome.REJECT)
    height, xy, opened = 30.0, (5.0, 5.0), False
    for call in rig.log.calls:
        if call.name == "move_linear":
            x, y, z, _, speed = call.arguments
            assert speed == table.limits.arm_speed_um_s / 1000
            assert (x, y) == xy or height == z == 60.0  # travels only at the retreat height
            assert opened or z >= height  # never down with closed jaws
            assert opened or height != 10.0  # and never up with a part between them
            height, xy = z, (x, y)
        elif call.name == "move":
            position, speed_counts, force_counts = call.arguments
            assert 20_000 + speed_counts * 130_000 / 255 <= table.limits.max_speed_um_s
            assert 20_000 + force_counts * 215_000 / 255 <= table.limits.max_force_mn
            opened = position == 0
    assert (height, opened) == (60.0, True)


def _first_path(table: Table) -> list:
    """The branches of the path that starts at the root and takes the first branch of each node."""
    branches, target = [], 0
    while target >= 0:
        branches.append(table.nodes[target].branches[0])
        target = branches[-1].target
    return branches


def assert_safe_end(rig: FakeCell, result: PartResult, *, failed: int) -> None:
    """Checks that the fingers stopped, the arm at most rose, and the journal has the outcome."""
    after = rig.log.calls[failed + 1 :]
    assert [call.name for call in after if call.name in ("move", "activate")] == []
    lifts = [call for call in after if call.name == "move_linear"]
    assert len(lifts) <= 1
    for lift in lifts:
        assert lift.arguments[2] == 60.0
    assert ("gripper", "stop") in [(call.device, call.name) for call in after]
    assert result.leaf is None
    assert len(result.safe_state) == 2
    kind, fields = rig.journal.kept[-1]
    ending = result.outcome.value, result.exit_code
    assert (kind, fields["outcome"], fields["exit_code"]) == ("outcome", *ending)


@pytest.mark.parametrize(
    ("error", "ends"),
    [
        (LinkError("cable"), (Outcome.FAULT, 21, "cable")),
        (KeyboardInterrupt(), (Outcome.STOPPED, 40, "stopped by the operator")),
    ],
)
@pytest.mark.parametrize(("table", "at"), CALLS)
def test_executor_lost_link_or_ctrl_c_at_any_call_ends_in_safe_state(table, at, error, ends):
    rig = fake_cell(LONGEST, Log(at, error))
    result = run(rig, table)
    assert (result.outcome, result.exit_code, result.reason) == ends
    assert_safe_end(rig, result, failed=at)
    if result.outcome is Outcome.STOPPED:
        # An arm that was interrupted in a call may be anywhere and is not moved; otherwise it is raised.
        lifted = any(call.name == "move_linear" for call in rig.log.calls[at + 1 :])
        if rig.log.calls[at].device == "arm":
            assert not lifted
        else:
            assert rig.arm.at[2] >= 60.0


@pytest.mark.parametrize(("table", "at"), CALLS)
def test_executor_foreign_error_is_raised_after_safe_state(table, at):
    rig = fake_cell(LONGEST, Log(at, ForeignError("a bug")))
    with pytest.raises(ForeignError):
        run(rig, table)
    assert ("gripper", "stop") in [(call.device, call.name) for call in rig.log.calls[at + 1 :]]
    assert rig.journal.kept[-1][1]["exit_code"] == 1


@pytest.mark.parametrize(
    ("table", "at"),
    [(small_table(), at) for at in range(6)] + [(pushing_table(), at) for at in range(9)],
)
def test_executor_failing_journal_is_fault_without_leaf(table, at, tmp_path):
    journal = FakeJournal(at, JournalError(tmp_path, "full"))
    rig = fake_cell(LONGEST, journal=journal)
    result = run(rig, table)
    assert (result.outcome, result.exit_code, result.leaf) == (Outcome.FAULT, 24, None)
    assert any("not journalled" in sentence for sentence in result.safe_state)
    assert rig.log.named("stop")


@pytest.mark.parametrize(
    ("error", "exit_code"),
    [
        *((kind("x"), 21) for kind in (LinkError, TimeoutError, OSError)),
        *((kind("x"), 20) for kind in (GripperFault, ArmError)),
    ],
)
def test_executor_device_error_ends_with_its_exit_code(error, exit_code):
    result = run(fake_cell(LONGEST, Log(4, error)))
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, exit_code)


def faulty(**changes: object) -> FakeCell:
    rig = fake_cell(LONGEST)
    rig.gripper.now = State(**changes)
    return rig


@pytest.mark.parametrize(
    ("rig", "reason"),
    [
        (faulty(activated=False), "not activated; clear the space"),
        (faulty(fault=0x0E), "fault 0x0E"),
        (faulty(moving=True), "without having been asked"),
    ],
)
def test_executor_unready_gripper_moves_neither_jaws_nor_arm(rig, reason):
    result = run(rig)
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, 20)
    assert reason in str(result.reason)
    assert rig.log.named("move") == []
    assert len(rig.log.named("move_linear")) <= 1  # the retreat of the safe sequence


def test_executor_stale_reading_is_fault_without_step():
    rig = fake_cell(LONGEST)
    rig.gripper.echo_off = -100
    result = run(rig)
    assert (result.outcome, result.exit_code, result.steps) == (Outcome.FAULT, 20, ())
    assert "stale reading" in str(result.reason)


@pytest.mark.parametrize(
    ("table", "stuck_at", "said"),
    [(small_table(), 5, "remove what blocks"), (pushing_table(), -20, "look for what is between")],
    ids=["opening", "closing to push"],
)
def test_executor_blocked_jaws_are_not_lowered(table, stuck_at, said):
    rig = fake_cell(LONGEST)
    rig.gripper.opened_to = stuck_at
    result = run(rig, table)
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, 20)
    assert said in str(result.reason)
    assert all(call.arguments[2] >= 30.0 for call in rig.log.named("move_linear"))


@pytest.mark.parametrize("off_mm", [0.6, float("nan")])
def test_executor_arm_off_target_is_not_moved_again(off_mm):
    rig = fake_cell(LONGEST)
    rig.arm.off_mm = off_mm
    result = run(rig)
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, 20)
    assert len(rig.log.named("move_linear")) <= 1
    assert "arm not moved: state unknown" in result.safe_state


def test_executor_table_beyond_gripper_is_refused_before_motion():
    rig = fake_cell([])
    with pytest.raises(TableError, match=r"node 0 .* the gripper does 20\.\."):
        run(rig, changed(small_table(), {"nodes.0.squeeze.speed_um_s": 19_000}))
    assert rig.log.calls == []
