"""The devices that a run connects to and locks."""

from contextlib import ExitStack
from types import SimpleNamespace

import pytest
from fake_cell import Deaf, fake_cell
from sample_tables import small_table

from runtime.commands import arguments
from runtime.commands.cell import connect
from runtime.devices.lock import PortLock
from runtime.shell.errors import UnreachableError


@pytest.mark.parametrize(
    ("gripper", "arm"),
    [
        ("urcap://192.0.2.10", "ur://192.0.2.10"),
        ("rtu+tcp://192.0.2.10:54321", "ur://192.0.2.10"),
        ("urcap://192.0.2.10", "manual"),
        ("manual", "ur://192.0.2.10:30004"),
    ],
)
def test_connect_documented_ur_commands_lock_both_devices(gripper, arm):
    rig = fake_cell([])
    drivers = SimpleNamespace(gripper=lambda *_, **__: rig.gripper, arm=lambda *_, **__: rig.arm)
    parsed = arguments.parser().parse_args(["--tree", "t", "--port", gripper, "--arm", arm])
    recipe = SimpleNamespace(loaded=SimpleNamespace(table=small_table()), console=Deaf())
    with ExitStack() as stack:
        connect(parsed, recipe, drivers, stack, lambda kind, fields: None)
        for device in (gripper, arm):
            if device != "manual":
                with pytest.raises(UnreachableError):
                    PortLock(device)
