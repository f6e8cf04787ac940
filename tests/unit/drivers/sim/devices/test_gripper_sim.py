"""The simulated 2F-85 behaves as the manuals say, in simulated time."""

import random

import pytest
from counting import width_um
from schunk_rigs import Part

from drivers.robotiq.registers import OUTPUT_FIELDS, decode, pack, speed_mm_s_of
from drivers.sim.devices.gripper import GripperModel


def width_mm(count):
    """The width of a part that stops the jaws at a count."""
    return None if count is None else width_um(count) / 1000.0


class Bench:
    """A simulated gripper, a part that stops its fingers at the count `contact`, and the simulated time."""

    def __init__(self, contact=None, seed=1):
        self.part = Part(width_mm(contact))
        self.now = 0.0
        self.model = GripperModel(random.Random(seed), self.part)

    def write(self, **fields):
        self.model.write_output(0, pack(OUTPUT_FIELDS, fields), self.now)

    def read(self, after=0.0):
        self.now += after
        return decode(self.model.read_input(self.now))

    def traffic(self, seconds):
        """Polls the gripper for some seconds, since silence would cause fault 9; returns the last status."""
        for _ in range(round(seconds / 0.05)):
            self.read(0.05)
        return self.read()

    def activated(self):
        width_mm, self.part.width_mm = self.part.width_mm, None
        self.write(rACT=1)
        assert self.traffic(6.0).activated
        self.part.width_mm, self.part.asked = width_mm, 0
        return self


def test_gripper_model_activation_takes_seconds_and_ends_open():
    bench = Bench()
    bench.write(rACT=1)
    positions = []
    while not (seen := bench.read(0.05)).activated:
        assert seen.activating
        positions.append(seen.position_counts)
        assert bench.now < 10.0
    assert bench.now > 1.0
    assert max(positions) > 225
    assert seen.position_counts == 3


def test_gripper_model_command_in_reset_is_fault_7():
    bench = Bench()
    bench.write(rGTO=1, rPR=100)
    assert bench.read(0.05).fault == 0x07
    assert bench.read(0.2).position_counts == 3


def test_gripper_model_command_during_activation_is_fault_5_then_obeyed():
    bench = Bench()
    bench.write(rACT=1)
    bench.read(0.05)
    bench.write(rACT=1, rGTO=1, rPR=100, rSP=255)
    seen = bench.read(0.05)
    assert seen.fault == 0x05
    assert not seen.going  # gGTO reads 0 while activating
    seen = bench.traffic(6.0)
    assert (seen.fault, seen.activated, seen.position_counts) == (0, True, 100)


def test_gripper_model_blocked_activation_is_fault_d_until_reset():
    bench = Bench(contact=150)
    bench.write(rACT=1)
    seen = bench.traffic(5.0)
    assert (seen.fault, seen.activated, seen.position_counts) == (0x0D, False, 150)
    bench.write(rACT=1, rGTO=1, rPR=0, rSP=255)
    assert bench.traffic(1.0).position_counts == 150
    bench.write()
    assert bench.read(0.05).fault == 0
    bench.part.width_mm = None
    bench.write(rACT=1)
    assert bench.traffic(6.0).activated


def test_gripper_model_request_echoes_at_once_and_object_flag_late():
    for seed in range(30):
        bench = Bench(seed=seed).activated()
        bench.write(rACT=1, rGTO=1, rPR=200, rSP=0)
        seen = bench.read()
        assert seen.echo_counts == 200
        assert seen.object_flag == 3  # still that of the previous move
        late = 0.0
        while bench.read(GripperModel.CYCLE_S).object_flag == 3:
            late += GripperModel.CYCLE_S
        assert late <= 5.001 * GripperModel.CYCLE_S


@pytest.mark.parametrize("speed", [0, 100, 255])
def test_gripper_model_speed_is_linear_in_rsp(speed):
    bench = Bench().activated()
    bench.write(rACT=1, rGTO=1, rPR=255, rSP=speed)
    first, t = bench.read(0.1), 0.3
    second = bench.read(t)
    travelled = (second.position_counts - first.position_counts) * 85.0 / 227.0
    assert travelled == pytest.approx(
        speed_mm_s_of(speed) * t, abs=85.0 / 227.0 + speed_mm_s_of(speed) * GripperModel.CYCLE_S
    )


@pytest.mark.parametrize("asked", [0, 3, 100, 230, 255])
def test_gripper_model_position_is_limited_by_end_stops(asked):
    bench = Bench().activated()
    bench.write(rACT=1, rGTO=1, rPR=120, rSP=255)
    bench.traffic(2.0)
    bench.write(rACT=1, rGTO=1, rPR=asked, rSP=255)
    seen = bench.traffic(2.0)
    assert (seen.position_counts, seen.object_flag) == (min(max(asked, 3), 230), 3)
    assert seen.echo_counts == asked


def test_gripper_model_contact_stops_jaws_and_raises_current():
    bench = Bench(contact=174).activated()
    bench.write(rACT=1, rGTO=1, rPR=255, rSP=255, rFR=128)
    moving = bench.read(0.2)
    assert moving.moving
    peak = max(bench.read(0.01).current_ma for _ in range(100))
    seen = bench.read()
    assert (seen.position_counts, seen.object_flag, seen.echo_counts) == (174, 2, 255)
    assert peak > moving.current_ma > 0
    assert bench.part.grips == 1


def test_gripper_model_reopened_and_closed_grips_again():
    bench = Bench(contact=174).activated()
    for squeeze in (1, 2, 3):
        bench.write(rACT=1, rGTO=1, rPR=255, rSP=255)
        bench.traffic(2.0)
        bench.write(rACT=1, rGTO=1, rPR=0, rSP=255)
        seen = bench.traffic(2.0)
        assert (seen.position_counts, seen.object_flag, seen.current_ma) == (3, 3, 0)
        assert (bench.part.asked, bench.part.grips) == (squeeze, squeeze)


def test_gripper_model_opened_at_open_end_releases_part():
    bench = Bench(contact=3).activated()
    bench.write(rACT=1, rGTO=1, rPR=230, rSP=255)
    assert bench.traffic(1.0).position_counts == 3
    bench.write(rACT=1, rGTO=1, rPR=3, rSP=255)
    bench.part.width_mm = width_mm(100)
    bench.traffic(0.5)
    bench.write(rACT=1, rGTO=1, rPR=230, rSP=255)
    assert bench.traffic(2.0).position_counts == 100
    assert (bench.part.grips, bench.part.releases) == (2, 1)


def test_gripper_model_stopped_halfway_stands_without_grip():
    bench = Bench(contact=174).activated()
    bench.write(rACT=1, rGTO=1, rPR=255, rSP=0)
    bench.read(0.5)
    bench.write(rACT=1, rPR=255)
    here = bench.read(0.01)
    assert not here.going
    assert here.echo_counts == 255
    assert bench.traffic(3.0).position_counts == here.position_counts
    assert bench.part.grips == 0


def test_gripper_model_contact_without_reads_is_counted():
    bench = Bench(contact=174).activated()
    bench.write(rACT=1, rGTO=1, rPR=255, rSP=255)
    bench.now += 5.0
    bench.write(rACT=1, rGTO=1, rPR=0, rSP=255)
    assert bench.part.grips == 1


def test_gripper_model_silence_is_fault_9_in_first_answer_only():
    bench = Bench().activated()
    assert bench.read(0.9).fault == 0
    assert bench.read(1.1).fault == 0x09
    assert bench.read(GripperModel.CYCLE_S).fault == 0
    bench.now += 2.0
    bench.write(rACT=1)
    assert bench.read(GripperModel.CYCLE_S).fault == 0


@pytest.mark.parametrize(("direction", "ends_at"), [(1, 3), (0, 230)])
def test_gripper_model_automatic_release_latches_until_activated(direction, ends_at):
    bench = Bench().activated()
    bench.write(rACT=1, rGTO=1, rPR=100, rSP=255)
    bench.traffic(2.0)
    bench.write(rACT=1, rATR=1, rARD=direction, rGTO=1, rPR=100)
    seen = bench.read(0.1)
    assert (seen.fault, seen.going) == (0x0B, False)
    seen = bench.traffic(6.0)
    assert (seen.fault, seen.position_counts, seen.activated) == (0x0F, ends_at, False)
    bench.write(rACT=1, rGTO=1, rPR=50, rSP=255)
    assert bench.traffic(1.0).fault == 0x0F
    bench.write()
    bench.write(rACT=1)
    assert bench.traffic(6.0).activated
