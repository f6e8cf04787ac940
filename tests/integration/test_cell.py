"""`grasp-cell` as a process: real bytes, real files, real signals; the world is a stand-in."""

import contextlib
import json
import math
import os
import signal
import subprocess
from pathlib import Path

import pytest
from programs import CELL, JOB, ROOT, called, started

from drivers import connect
from drivers.sim.cli import main

SCALE = 20.0
SUPPORT = ROOT / "tests" / "support"
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(SUPPORT)))}
# `Running.end` closes stdin, which is another way to end.
ENDS = [("quit", 0), (signal.SIGTERM, 0), (signal.SIGINT, 130)]


class Running:
    def __init__(self, *arguments, world="fake_scene:make"):
        words = ["--job", JOB, "--world", world, "--time-scale", SCALE, *arguments]
        words = [*CELL, *words, "--json", "--until-stdin-closes"]
        self.process = started(words, stdin=subprocess.PIPE, env=ENVIRONMENT)
        self.endpoints = json.loads(self.process.stdout.readline())

    def end(self, code=0, said=""):
        """Closes stdin, waits for the end, and checks exit code and standard error."""
        with self.process as process:
            process.stdin.close()
            try:
                assert process.wait(20) == code
                assert process.stderr.read() == said
            finally:
                process.kill()

    @contextlib.contextmanager
    def connected(self, gripper="gripper", arm="arm"):
        ends, closing = self.endpoints, contextlib.closing
        with (
            closing(connect.gripper(ends[gripper], time_scale=SCALE)) as gripper,
            closing(connect.arm(ends[arm], time_scale=SCALE)) as arm,
            closing(connect.scene(ends["scene"])) as scene,
        ):
            yield gripper, arm, scene


@pytest.fixture(scope="module")
def cell():
    running = Running("--seed", 7)
    yield running
    running.end()


def squeeze(gripper, arm, x_mm, y_mm, angle_rad):
    """Lowers the hand, closes and opens the jaws, lifts the hand; returns the settled reading."""
    arm.move_linear((x_mm, y_mm, 60.0, angle_rad), 250.0)
    arm.move_linear((x_mm, y_mm, 8.0, angle_rad), 250.0)
    gripper.move(-1, 71.0, 37.0)
    settled = gripper.wait()
    gripper.move(85_000, 150.0, 20.0)
    gripper.wait()
    arm.move_linear((x_mm, y_mm, 60.0, angle_rad), 250.0)
    return settled


@pytest.mark.parametrize(("gripper", "arm"), [("gripper", "arm"), ("gripper_urcap", "arm_ur")])
def test_grasp_cell_part_starts_in_disc_and_is_aligned_by_squeezes(cell, gripper, arm):
    names = "gripper arm scene world gripper_tcp gripper_rtu_tcp gripper_urcap arm_logger arm_ur"
    assert set(cell.endpoints) == set(names.split())
    with cell.connected(gripper, arm) as (gripper, arm, scene):
        gripper.activate()
        part = scene.next_part()
        start = scene.truth()
        assert math.hypot(start.x_mm, start.y_mm) <= 12.75
        assert (start.squeezes, start.crashes, start.status) == (0, 0, "untouched")
        for k in range(2):
            angle = 0.3 + 0.9 * k
            settled = squeeze(gripper, arm, 2.0, -3.0, angle)
            assert settled.width_um / 1000 == pytest.approx(21.0, abs=5 * 0.15 + 0.2)
            assert settled.object == 2
            seen = scene.truth()
            # The world centred the part between the fingers and lined it up with them.
            across = -math.sin(angle) * (seen.x_mm - 2.0) + math.cos(angle) * (seen.y_mm + 3.0)
            assert across == pytest.approx(0.0, abs=0.01)
            off = math.remainder(seen.theta_rad - angle, math.tau)
            assert off == pytest.approx(0.0, abs=1e-4)
            assert (seen.squeezes, seen.status) == (k + 1, "grasped")
        assert scene.next_part() == part + 1
        with pytest.raises(ConnectionError, match="known"):
            scene._ask("dance")
        assert scene.truth() is not None


def test_grasp_cell_activation_faults_at_part_and_succeeds_above_it(cell):
    with cell.connected() as (gripper, arm, scene):
        gripper._link.write(bytes(6))  # inactive
        arm.move_linear((0.0, 0.0, 60.0, 0.0), 250.0)
        arm.move_linear((0.0, 0.0, 8.0, 0.0), 250.0)
        with pytest.raises(RuntimeError, match="0x0D"):
            gripper.activate()
        arm.move_linear((0.0, 0.0, 60.0, 0.0), 250.0)
        gripper.activate()
        scene.next_part()
        before = scene.truth()
        arm.move_linear((0.0, 0.0, 60.0, 0.0), 250.0)
        gripper.move(-1, 150.0, 20.0)
        assert gripper.wait().object == 3
        gripper.move(85_000, 150.0, 20.0)
        assert gripper.wait().width_um == 85_000
        assert scene.truth() == before


def test_grasp_cell_fingers_placed_on_part_are_a_crash(cell):
    with cell.connected() as (gripper, arm, scene):
        gripper.activate()
        scene.next_part()
        seen = scene.truth()
        arm.move_linear((seen.x_mm, seen.y_mm + 40.0, 60.0, 0.0), 250.0)
        arm.move_linear((seen.x_mm, seen.y_mm + 40.0, 8.0, 0.0), 250.0)
        assert scene.truth().crashes == 1
        arm.move_linear((seen.x_mm, seen.y_mm, 60.0, 0.0), 250.0)
        arm.move_linear((seen.x_mm, seen.y_mm, 8.0, 0.0), 250.0)
        assert scene.truth().crashes == 1
        arm.move_linear((seen.x_mm, seen.y_mm, 60.0, 0.0), 250.0)


@pytest.mark.parametrize(("how", "code"), ENDS)
def test_grasp_cell_quit_or_signal_ends_process_with_its_code(how, code):
    running = Running()
    if how == "quit":
        with contextlib.closing(connect.scene(running.endpoints["scene"])) as scene:
            scene._ask("quit")
    else:
        running.process.send_signal(how)
    assert running.process.wait(20) == code
    running.end(code, "grasp-cell: interrupted\n" if code == 130 else "")


def test_grasp_cell_failing_world_ends_process_with_code_1():
    running = Running(world="fake_scene:stumbling")
    with running.connected() as (gripper, arm, _):
        arm.move_linear((0.0, 0.0, 8.0, 0.0), 250.0)
        with pytest.raises((ConnectionError, RuntimeError)):
            gripper.activate()
    assert running.process.wait(20) == 1
    running.end(1, "grasp-cell: stopped: no such squeeze\n")


BAD_WORLDS = {
    "nocolon": "module:factory",
    "no.such.module:make": "cannot be imported",
    "fake_scene:missing": "no function missing",
    "fake_scene:not_callable": "no function",
    "fake_scene:broken": "this world is broken",
    "runtime.devices.rehearsal:make": "--tree",
}


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("--job", "no/such/job.toml"), 3, "no/such/job.toml"),
        (("--tree", "no/such/tree.msgpack"), 3, "no/such/tree.msgpack"),
        (("--job", "broken"), 3, "broken"),
        (("--tree", "broken"), 3, "broken"),
        (("--job", str(JOB), "--time-scale", "0"), 2, "not a positive number"),
        *((("--job", str(JOB), "--world", world), 2, says) for world, says in BAD_WORLDS.items()),
    ],
)
def test_grasp_cell_bad_arguments_are_refused_in_one_line(words, code, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("broken").write_text("[part\n")
    ended, out, err = called(main, *words)
    assert (ended, out, len(err.splitlines())) == (code, "", 1), err
    assert err.startswith("grasp-cell: ")
    assert says in err
