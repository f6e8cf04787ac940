"""`grasp-cell` as a process: real bytes, real files, real signals; the world is a stand-in."""

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers import connect

ROOT = Path(__file__).parents[2]
JOB = ROOT / "trees" / "rectangle" / "job.toml"
SCALE = 20.0
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(Path(__file__).parent)))}
ENDS = [
    ("quit", 0),
    (signal.SIGTERM, 0),
    (signal.SIGINT, 130),
    ("stdin", 0),
]


def launch(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "drivers.sim.cli", *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=ROOT,
        env=ENVIRONMENT,
        text=True,
    )


def refuse(*arguments):
    """Run to the end; returns the exit code and the one line it said."""
    process = launch(*arguments)
    out, err = process.communicate(timeout=60)
    assert out == ""
    assert len(err.splitlines()) == 1, err
    assert err.startswith("grasp-cell: ")
    return process.returncode, err


class Running:
    def __init__(self, *arguments, world="fake_world:make"):
        self.process = launch(
            "--job",
            JOB,
            "--world",
            world,
            "--time-scale",
            SCALE,
            "--json",
            "--until-stdin-closes",
            *arguments,
        )
        self.endpoints = json.loads(self.process.stdout.readline())

    def end(self, code=0, said=""):
        """Close its stdin, wait for it, and compare what it left behind."""
        with self.process as process:
            process.stdin.close()
            try:
                assert process.wait(20) == code
                assert process.stderr.read() == said
            finally:
                process.kill()

    @contextlib.contextmanager
    def connected(self, gripper="gripper", arm="arm"):
        with (
            contextlib.closing(
                connect.gripper(self.endpoints[gripper], time_scale=SCALE)
            ) as gripper,
            contextlib.closing(connect.arm(self.endpoints[arm], time_scale=SCALE)) as arm,
            contextlib.closing(connect.scene(self.endpoints["scene"])) as scene,
        ):
            yield gripper, arm, scene


@pytest.fixture(scope="module")
def cell():
    running = Running("--seed", 7)
    yield running
    running.end()


def squeeze(gripper, arm, x_mm, y_mm, angle_rad):
    """Place, close, open; returns the settled reading."""
    arm.move_linear(x_mm, y_mm, 60.0, angle_rad, 250.0)
    arm.move_linear(x_mm, y_mm, 8.0, angle_rad, 250.0)
    gripper.move(-1, 71.0, 37.0)
    settled = gripper.wait()
    gripper.move(85_000, 150.0, 20.0)
    gripper.wait()
    arm.move_linear(x_mm, y_mm, 60.0, angle_rad, 250.0)
    return settled


def test_endpoints(cell):
    assert set(cell.endpoints) == {
        *("gripper", "arm", "scene", "world"),
        *("gripper_tcp", "gripper_rtu_tcp", "gripper_urcap", "arm_logger", "arm_ur"),
    }
    assert cell.endpoints["world"] == "fake_world:make"
    assert Path(cell.endpoints["gripper"]).is_char_device()


@pytest.mark.parametrize(("gripper", "arm"), [("gripper", "arm"), ("gripper_urcap", "arm_ur")])
def test_parts_lie_in_the_uncertainty_disc_and_move_only_when_squeezed(cell, gripper, arm):
    with cell.connected(gripper, arm) as (gripper, arm, scene):
        gripper.activate()
        for _ in range(3):
            part = scene.next_part()
            start = scene.truth()
            assert math.hypot(start.x_mm, start.y_mm) <= 12.75
            assert (start.squeezes, start.crashes, start.status) == (0, 0, "untouched")
            for k in range(2):
                angle = 0.3 + 0.9 * k
                settled = squeeze(gripper, arm, 2.0, -3.0, angle)
                width = settled.width_um / 1000
                assert width == pytest.approx(21.0, abs=5 * 0.15 + 0.2)
                assert settled.object == 2
                seen = scene.truth()
                # The world centred the part between the fingers and lined it up with them.
                across = -math.sin(angle) * (seen.x_mm - 2.0) + math.cos(angle) * (seen.y_mm + 3.0)
                assert across == pytest.approx(0.0, abs=0.01)
                assert math.remainder(seen.theta_rad - angle, math.tau) == pytest.approx(
                    0.0, abs=1e-4
                )
                assert (seen.squeezes, seen.status) == (k + 1, "grasped")
            assert scene.next_part() == part + 1


def test_above_the_part_the_fingers_meet_nothing(cell):
    with cell.connected() as (gripper, arm, scene):
        gripper.activate()
        scene.next_part()
        before = scene.truth()
        arm.move_linear(0.0, 0.0, 60.0, 0.0, 250.0)
        gripper.move(-1, 150.0, 20.0)
        assert gripper.wait().object == 3
        gripper.move(85_000, 150.0, 20.0)
        assert gripper.wait().width_um == 85_000
        assert scene.truth() == before


def test_fingers_placed_on_the_part_are_a_crash(cell):
    with cell.connected() as (gripper, arm, scene):
        gripper.activate()
        scene.next_part()
        seen = scene.truth()
        arm.move_linear(seen.x_mm, seen.y_mm + 40.0, 60.0, 0.0, 250.0)
        arm.move_linear(seen.x_mm, seen.y_mm + 40.0, 8.0, 0.0, 250.0)
        assert scene.truth().crashes == 1
        arm.move_linear(seen.x_mm, seen.y_mm, 60.0, 0.0, 250.0)
        arm.move_linear(seen.x_mm, seen.y_mm, 8.0, 0.0, 250.0)
        assert scene.truth().crashes == 1
        arm.move_linear(seen.x_mm, seen.y_mm, 60.0, 0.0, 250.0)


def test_a_sweep_at_the_part_ends_in_an_activation_fault():
    running = Running()
    try:
        with running.connected() as (gripper, arm, _):
            arm.move_linear(0.0, 0.0, 8.0, 0.0, 250.0)
            with pytest.raises(RuntimeError, match="0x0D"):
                gripper.activate()
    finally:
        running.end()


def test_same_seed_same_parts_and_widths():
    def run(seed):
        running = Running("--seed", seed)
        with running.connected() as (gripper, arm, scene):
            gripper.activate()
            lines = []
            for _ in range(3):
                scene.next_part()
                lines.append(
                    (
                        scene.truth(),
                        squeeze(gripper, arm, 0.0, 0.0, 0.5).width_um,
                        scene.truth(),
                    )
                )
        running.end()
        return lines

    assert run(3) == run(3)
    assert run(3) != run(4)


def test_a_world_without_a_part_lets_the_jaws_close():
    running = Running(world="fake_world:nothing")
    with running.connected() as (gripper, arm, scene):
        gripper.activate()
        settled = squeeze(gripper, arm, 0.0, 0.0, 0.0)
        assert (settled.width_um, settled.object) == (0, 3)
        assert (scene.truth().status, scene.truth().crashes) == ("untouched", 0)
    running.end()


@pytest.mark.parametrize(("how", "code"), ENDS)
def test_every_way_to_end(how, code):
    running = Running()
    if how == "quit":
        with contextlib.closing(connect.scene(running.endpoints["scene"])) as scene:
            scene._ask("quit")
    elif how != "stdin":
        running.process.send_signal(how)
    if how != "stdin":
        assert running.process.wait(20) == code
    running.end(code, "grasp-cell: interrupted\n" if code == 130 else "")


def test_a_world_that_fails_ends_the_cell_instead_of_leaving_a_mute_gripper():
    running = Running(world="fake_world:stumbling")
    with running.connected() as (gripper, arm, _):
        arm.move_linear(0.0, 0.0, 8.0, 0.0, 250.0)
        with pytest.raises((ConnectionError, RuntimeError)):
            gripper.activate()
    assert running.process.wait(20) == 1
    running.end(1, "grasp-cell: stopped: no such squeeze\n")


def test_a_client_that_asks_nonsense_is_answered(cell):
    with contextlib.closing(connect.scene(cell.endpoints["scene"])) as scene:
        with pytest.raises(ConnectionError, match="known"):
            scene._ask("dance")
        assert scene.truth() is not None


def test_missing_file():
    code, line = refuse("--job", "no/such/job.toml")
    assert code == 3
    assert "no/such/job.toml" in line
    assert refuse("--tree", "no/such/tree.msgpack")[0] == 3


def test_broken_inputs(tmp_path):
    broken = tmp_path / "broken"
    broken.write_text("[part\n")
    assert refuse("--job", broken)[0] == 3
    assert refuse("--tree", broken)[0] == 3


@pytest.mark.parametrize(
    ("world", "says"),
    [
        ("nocolon", "module:factory"),
        ("no.such.module:make", "cannot be imported"),
        ("fake_world:missing", "no function missing"),
        ("fake_world:not_callable", "no function"),
        ("fake_world:broken", "this world is broken"),
        ("runtime.devices.rehearsal:make", "--tree"),
    ],
)
def test_worlds_that_cannot_be_had(world, says):
    code, line = refuse("--job", JOB, "--world", world)
    assert code == 2
    assert says in line


def test_usage():
    process = launch("--job", JOB, "--time-scale", "0")
    _, err = process.communicate(timeout=20)
    assert process.returncode == 2
    assert "not a positive number" in err


def test_help_shows_an_example_and_exit_codes():
    out, _ = launch("--help").communicate(timeout=20)
    assert "example:" in out
    assert "exit codes:" in out
