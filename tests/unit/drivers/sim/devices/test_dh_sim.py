"""The registers of the simulated DH gripper: what the manuals describe, and what they leave open."""

import random

import pytest
from schunk_rigs import Part

from drivers.dh import registers as dh
from drivers.dh.registers import Grip, Initialised
from drivers.sim.devices.dh import DhModel, DhRegisters
from runtime.table import profile_of


class Bench:
    """A simulated gripper, a part of a given width (or none) between its fingers, and the simulated time."""

    def __init__(self, width_mm=None):
        self.part = Part(width_mm)
        self.now = 0.0
        self.model = DhModel(random.Random(1), self.part, profile_of("dh-pgc140-50"))

    def write(self, register, value, then_s=2.0):
        self.model.write(register, value, self.now)
        self.now += then_s

    def read(self, register):
        return self.model.read(register, self.now)


@pytest.fixture
def ready():
    bench = Bench(20.0)
    bench.write(dh.INITIALISATION, dh.INITIALISE)
    return bench


def test_dh_model_at_power_on_is_uninitialised_and_stands():
    bench = Bench()
    bench.write(dh.POSITION, 0)
    assert bench.read(dh.INITIALISED) == Initialised.NO
    assert bench.read(dh.ACTUAL_POSITION) == dh.FULL


@pytest.mark.parametrize(("direction", "end"), [(0, dh.FULL), (1, 0)])
def test_dh_model_initialises_to_end_of_its_direction(direction, end):
    bench = Bench()
    bench.write(dh.DIRECTION, 1 - direction)
    bench.write(dh.INITIALISATION, dh.INITIALISE)  # first to the other end
    bench.write(dh.DIRECTION, direction)
    bench.write(dh.INITIALISATION, dh.INITIALISE, 0.0)
    assert bench.read(dh.INITIALISED) == Initialised.IN_PROGRESS
    assert bench.read(dh.INITIALISATION) == 1
    bench.now += 5.0
    assert bench.read(dh.INITIALISED) == Initialised.YES
    assert bench.read(dh.INITIALISATION) == 0
    assert bench.read(dh.ACTUAL_POSITION) == end


def test_dh_model_calibrated_on_part_takes_it_for_end(ready):
    ready.write(dh.INITIALISATION, dh.CALIBRATE, 10.0)
    ready.write(dh.POSITION, 0)
    assert ready.read(dh.ACTUAL_POSITION) == 0
    assert ready.model.opening_mm(ready.now) == pytest.approx(20.0)


def test_dh_model_part_is_caught_and_released(ready):
    ready.write(dh.POSITION, 0)
    assert (ready.read(dh.GRIP), ready.read(dh.ACTUAL_POSITION)) == (Grip.CAUGHT, 400)
    ready.write(dh.POSITION, dh.FULL)
    assert (ready.read(dh.GRIP), ready.read(dh.ACTUAL_POSITION)) == (Grip.AT_POSITION, dh.FULL)
    assert (ready.part.grips, ready.part.releases) == (1, 1)


def test_dh_model_dropped_part_lets_fingers_reach_position(ready):
    ready.write(dh.POSITION, 0)
    ready.model.lose_object(ready.now)
    ready.now += 2.0
    assert (ready.read(dh.GRIP), ready.read(dh.ACTUAL_POSITION)) == (Grip.DROPPED, 0)


def test_dh_model_stroke_takes_time_of_data_sheet(ready):
    ready.part.width_mm = None
    ready.write(dh.SPEED, 100)
    ready.write(dh.POSITION, 0, 0.69)
    assert ready.read(dh.ACTUAL_POSITION) > 0
    ready.now += 0.02
    assert ready.read(dh.ACTUAL_POSITION) == 0


@pytest.mark.parametrize(
    ("register", "value"),
    [(dh.POSITION, 1001), (dh.FORCE, 19), (dh.SPEED, 0), (dh.GRIP, 1), (0x0102, 5)],
)
def test_dh_registers_value_not_allowed_is_refused(ready, register, value):
    registers = DhRegisters(ready.model, lambda: ready.now)
    writes = ready.model.writes
    assert not registers.write(register, value.to_bytes(2, "big"))
    both = (50).to_bytes(2, "big") + value.to_bytes(2, "big")
    assert not registers.write(register - 1, both)
    assert ready.model.writes == writes
