"""`grasp-calibrate middle` stopped at any moment: a fixed block that may be held is never lifted."""

from types import SimpleNamespace

import pytest
from calibrations import linear
from fake_scene import setting
from sample_tables import small_table

from drivers.sim.physics.scene import Block
from drivers.sim.virtual.cell import VirtualCell
from runtime.commands import calibrate, calibrate_middle
from runtime.table import dump

BLOCK_MM = 30.0
LOW_MM = small_table().limits.squeeze_height_um / 1000
MOVING = ("move", "wait", "move_linear")


class Interrupted:
    """A device that logs its moving calls; the call with the index `at` in the log ends in a stop request."""

    def __init__(self, device: object, log: list[str], at: int) -> None:
        self._device, self._log, self._at = device, log, at

    def __getattr__(self, name: str) -> object:
        method = getattr(self._device, name)
        if name not in MOVING:
            return method

        def call(*arguments: float) -> object:
            self._log.append(name)
            answer = method(*arguments)
            if len(self._log) - 1 == self._at:
                raise KeyboardInterrupt
            return answer

        return call


def drivers(cell: VirtualCell, log: list[str], at: int) -> SimpleNamespace:
    """Drivers of a cell's gripper and arm, each an `Interrupted` device; both write to the same log."""
    return SimpleNamespace(
        gripper=lambda port, profile: Interrupted(cell.gripper(), log, at),
        arm=lambda port: Interrupted(cell.arm(), log, at),
    )


@pytest.fixture
def arguments(tmp_path):
    tree, widths = tmp_path / "t.msgpack", linear(tmp_path / "g.json", "S/N-1")
    dump(small_table(), tree)
    words = ["middle", "--port", f"{tmp_path}/gripper", "--arm", f"{tmp_path}/arm", "--activate"]
    words += ["--tree", str(tree), "--calibration", str(widths), "--block", f"{BLOCK_MM:g}"]
    return calibrate.parser().parse_args([*words, "-o", str(tmp_path / "o.json")])


@pytest.mark.parametrize("tips", ["straight", "57.15,5"])
def test_calibrate_middle_stopped_never_lifts_the_fixed_block(arguments, tips):
    arguments.tips = tips
    gripped = 0
    for number in range(45):  # the first two grips
        cell = VirtualCell(setting()._replace(block=Block(BLOCK_MM)), 5)
        log: list[str] = []
        with pytest.raises(KeyboardInterrupt) as stopped:
            calibrate_middle.run(arguments, drivers(cell, log, number), lambda sentence: None)
        now_s = cell.clock.now()
        holds = cell.works.gripper.opening_mm(now_s) < BLOCK_MM + 15.0
        height_mm = cell.works.arm.pose_at(now_s).z_mm
        notes = stopped.value.__notes__
        assert notes[0].startswith("fingers stopped")
        if holds:
            gripped += 1
            assert height_mm < LOW_MM + 20.0, (number, log)
            assert "arm not moved" in notes[1]
    assert gripped >= 2
