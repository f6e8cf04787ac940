"""Tests that the example drivers fulfil the contracts of grippers and arms, on simulated devices."""

import contextlib
import math
import time

import pytest
from other_make import PROFILE

from drivers import connect
from drivers.contract.arm import ArmContract
from drivers.contract.gripper import GripperContract
from drivers.errors import LinkError
from drivers.sim.wire.serving import Site

SCALE = 20.0  # simulated seconds a second


class TestOtherGripper(GripperContract):
    def make(self):
        return GripperRig()


@pytest.mark.parametrize("said", ["", "1 0 0 60.000", "1 0 0 60.000 wide", "1 0 0 inf 60.000"])
def test_state_answer_that_is_no_status_is_an_error_of_the_link(said):
    with contextlib.closing(GripperRig()) as rig, rig.open() as gripper:
        rig.says(said)
        with pytest.raises(LinkError, match="check its make"):
            gripper.state()


class TestOtherArm(ArmContract):
    def make(self):
        return ArmRig()


class GripperDevice:
    """Simulates a gripper: the fingers move at the requested speed, and stop at `contact_mm`.

    `now` returns simulated seconds.
    """

    def __init__(self, now) -> None:
        self.now = now
        self.contact_mm, self.mute = None, False
        self.commands = 0
        self.asked = self.start = self.stop_mm = PROFILE.stroke_um / 1000
        self.since, self.speed = 0.0, 1.0
        self.ready = self.held = False

    def answer(self, words):
        if self.mute:
            return None
        if words[0] == "status":
            moving = self.at() != self.stop_mm
            held = self.held and not moving
            return f"{self.ready:d} {moving:d} {held:d} {self.asked:.3f} {self.at():.3f}"
        self.commands += 1
        if words[0] == "home":
            self.ready = True
        elif words[0] == "go" and self.ready:
            self.start, self.asked, self.speed = self.at(), float(words[1]), float(words[2])
            blocked = (
                self.contact_mm is not None and self.asked <= self.contact_mm < self.start + 1e-6
            )
            self.held, self.stop_mm = blocked, self.contact_mm if blocked else self.asked
            self.since = self.now()
        elif words[0] == "stop":
            self.start = self.stop_mm = self.at()
        return "ok"

    def at(self) -> float:
        way = self.speed * (self.now() - self.since)
        left = self.stop_mm - self.start
        return self.stop_mm if abs(left) <= way else self.start + math.copysign(way, left)


class ArmDevice:
    """Simulates an arm: answers a motion when it has ended, and answers nothing if `mute`."""

    def __init__(self, _) -> None:
        self.mute, self.moves = False, 0
        self.place = (0.0, 0.0, 100.0, 0.0)

    def answer(self, words):
        if self.mute:
            return None
        if words[0] == "where":
            return " ".join(f"{value:.3f}" for value in self.place)
        x, y, z, angle, speed = map(float, words[1:])
        if math.hypot(x, y) > 250.0:
            return "no"
        time.sleep(math.dist(self.place[:3], (x, y, z)) / speed / SCALE)
        self.place, self.moves = (x, y, z, math.remainder(angle, math.tau)), self.moves + 1
        return "ok"


class Rig:
    """A simulated device, served on a TCP port; a subclass names the device's class in `device_of`."""

    def __init__(self):
        self._site = Site(SCALE)
        self._device = self.device_of(self._site.now)
        port = self._site.answer_lines(self._answered, most_bytes=256)
        self._address = f"other://127.0.0.1:{port}"

    def _answered(self, line):
        said = self._device.answer(line.decode().split())
        return b"" if said is None else said.encode() + b"\n"

    def silence(self):
        self._device.mute = True

    def close(self):
        self._site.close()


class GripperRig(Rig):
    device_of = GripperDevice
    contact_um = 24_000

    def open(self, *, read_only=False):
        options = {"time_scale": SCALE, "read_only": read_only}
        return contextlib.closing(connect.gripper(self._address, **options))

    def put_part(self):
        self._device.contact_mm = 24.0

    def commanded(self):
        return self._device.commands > 0

    def commands(self):
        return self._device.commands

    def says(self, line):
        self._device.answer = lambda words: line


class ArmRig(Rig):
    device_of = ArmDevice
    far_mm = 900.0

    @property
    def moves(self):
        return self._device.moves

    def open(self, *, read_only=False):
        options = {"time_scale": SCALE, "read_only": read_only}
        return contextlib.closing(connect.arm(self._address, **options))

    def truth(self):
        return self._device.place
