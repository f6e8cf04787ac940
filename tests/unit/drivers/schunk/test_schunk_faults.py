"""A simulated SCHUNK gripper reports its counterparts of the faults of a schedule."""

import random

import pytest

from drivers.schunk.registers import PARAMETERS, Input
from drivers.sim.devices.faulty import FaultySchunkModel
from drivers.sim.devices.jaws import Surroundings
from drivers.sim.faults import Desk, Fault, Listed
from runtime.table import PROFILES


@pytest.mark.parametrize(("kind", "error"), [("gflt_08", 0x6D), ("gflt_0e", 0x74)])
def test_fault_of_a_schedule_is_an_error_of_the_gripper(kind, error):
    desk = Desk(Listed((Fault(kind, at=0),)))
    model = FaultySchunkModel(random.Random(1), Surroundings(), PROFILES["schunk-egu"], desk)
    data = model.read("plc_sync_input", 0.1)
    assert Input.of(PARAMETERS["plc_sync_input"].unpack(data)).error == error
