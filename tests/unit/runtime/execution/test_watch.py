"""The deadline of a squeeze: when it raises, and which device it names."""

import time
from dataclasses import replace

import pytest
from fake_cell import Deaf, FakeClock, fake_cell
from sample_tables import small_table

from runtime.devices import clock as clocks
from runtime.devices.clock import SystemClock
from runtime.errors import MotionRefusedError
from runtime.execution.executor import Executor
from runtime.execution.watch import DEADLINE_FACTOR, Expected, Watch, expected_of
from runtime.shell.errors import ExpectedError
from runtime.shell.interrupts import StopRequests, stoppable
from runtime.traversal.results import Outcome


class SlowDevice:
    """A device whose call takes `seconds` of the clock."""

    def __init__(self, clock, seconds):
        self.clock, self.seconds, self.calls = clock, seconds, 0

    def call(self):
        self.calls += 1
        self.clock.sleep(self.seconds)


@pytest.mark.parametrize(
    ("slow", "message", "called"),
    [
        ("gripper", "the gripper took 40.0 s, 4.0 s are usual", [1, 0, 0]),
        ("arm", "the arm took 40.0 s, 6.0 s are usual", [1, 1, 2]),
        ("this machine", "this machine took 80.0 s, 0.0 s are usual", [1, 1, 2]),
    ],
)
def test_watch_late_squeeze_names_cause_and_stops_device_calls(slow, message, called):
    clock = FakeClock()
    watch, names = Watch(clock), ("gripper", "arm", "this machine")
    devices = [SlowDevice(clock, 40.0 if name == slow else 1.0) for name in names]
    gripper, arm, journal = map(watch.watched, devices, names)

    def squeeze():
        with watch.squeeze(Expected(6.0, 4.0)):
            for device in (gripper, arm, journal, journal, gripper):
                device.call()

    with pytest.raises(ExpectedError, match=message) as raised:
        squeeze()
    assert raised.value.exit_code == 20
    assert [device.calls for device in devices] == called


def test_watch_scaled_clock_late_squeeze_counts_seconds_of_the_cell():
    clock = FakeClock()
    clock.time_scale = 20.0
    device = SlowDevice(clock, 40.0)  # seconds of the machine, 800 of the cell
    watch = Watch(clock)
    arm = watch.watched(device, "arm")
    with (
        pytest.raises(MotionRefusedError, match=r"the arm took 800\.0 s, 6\.0 s are usual"),
        watch.squeeze(Expected(6.0, 4.0)),
    ):
        arm.call()


def test_watch_squeeze_late_after_last_call_raises():
    clock = FakeClock()
    with (
        pytest.raises(ExpectedError, match="this machine took"),
        Watch(clock).squeeze(Expected(6, 4)),
    ):
        clock.sleep(200.0)


def test_watch_endless_call_ends_at_deadline(monkeypatch):
    """The deadline interrupts a call as a stop request does, whatever the driver waits for."""
    monkeypatch.setattr(clocks, "LINK_MARGIN_S", 0.1)
    watch = Watch(SystemClock())

    class Endless:
        def call(self):
            time.sleep(600.0)

    arm = watch.watched(Endless(), "arm")

    def squeeze():
        with stoppable(), watch.squeeze(Expected(0.01, 0.01)):
            arm.call()

    with StopRequests(), pytest.raises(ExpectedError, match="the arm took") as raised:
        squeeze()
    assert raised.value.exit_code == 20


def test_executor_slow_arm_is_fault_before_jaws_close():
    rig = fake_cell([(200, 2)])
    clock = rig.cell.clock
    table = small_table()
    budget = DEADLINE_FACTOR * expected_of(table, table.nodes[0]).total_s
    obeys = rig.arm.move_linear

    def slow(*target):
        clock.sleep(budget)
        obeys(*target)

    rig.arm.move_linear = slow
    result = Executor(table, replace(rig.cell), Deaf()).run_part(1)
    assert (result.outcome, result.exit_code) == (Outcome.FAULT, 20)
    assert "the arm took" in str(result.reason)
    assert not [call for call in rig.log.named("move") if call.arguments[0] == 255]
    assert "the arm took" in str(rig.journal.kept[-1])
