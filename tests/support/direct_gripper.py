"""The Robotiq driver with a link that calls the simulated gripper directly, on a virtual clock."""

import random
from typing import NamedTuple

from counting import PROFILE, SETTINGS, count_of, width_um

from drivers.clock import Pace
from drivers.robotiq.gripper import Gripper
from drivers.sim.devices.gripper import GripperModel

TRANSACTION_S = 0.006


class VirtualClock:
    def __init__(self):
        self.time = 100.0

    def now(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds

    def idle(self, seconds, until):
        self.time += max(min(seconds, until - self.time), 0.0)


class DirectLink:
    """A link to a simulated gripper in memory; each transaction takes 6 ms.

    A test may set the function `on_write`, which receives each written block. If it returns true, the block
    does not reach the gripper.
    """

    endpoint = "virtual"

    def __init__(self, seed=1, contact=None):
        self.clock = VirtualClock()
        self.contact = contact
        self.asked = 0
        self.writes = []
        self.frozen = None
        self.on_write = None
        self.model = GripperModel(random.Random(seed), self)

    def closing(self):
        self.asked += 1
        return None if self.contact is None else width_um(self.contact) / 1000.0

    def gripped(self):
        pass

    def released(self):
        pass

    def read(self):
        self.clock.time += TRANSACTION_S
        return self.frozen or self.model.read_input(self.clock.time)[:6]

    def write(self, block):
        self.clock.time += TRANSACTION_S
        self.writes.append(block)
        if self.on_write is not None and self.on_write(block):
            return
        self.model.write_output(0, block, self.clock.time)

    def close(self):
        self.clock.time += TRANSACTION_S


class Answer(NamedTuple):
    """A settled reading in counts."""

    position_counts: int
    object_flag: int
    current_ma: int
    echo_counts: int
    seconds: float


class Counted:
    """Wraps the driver for tests in counts: commands and readings are in register units."""

    def __init__(self, gripper):
        self.driver = gripper

    def __getattr__(self, name):
        return getattr(self.driver, name)

    def state(self):
        return self.driver._read()

    def move(self, position, speed, force):
        width = -1 if position == 255 else SETTINGS.target_um(position)
        fast, strong = PROFILE.speed_mm_s, PROFILE.force_n
        pairs = ((fast, speed), (strong, force))
        settings = (low + (high - low) * n / 255 for (low, high), n in pairs)
        self.driver.move(width, *(round(value + 0.0005, 3) for value in settings))

    def wait(self):
        seen = self.driver.wait()
        echo = self.driver._image["rPR"]
        assert seen.target_um == SETTINGS.target_um(echo)
        count = count_of(seen.width_um)
        return Answer(count, int(seen.object), seen.current_ma, echo, seen.seconds)


def connect(link):
    return Counted(Gripper(link, Pace(link.clock)))


def reset(**options):
    """Returns a link to a gripper that was never activated, and the gripper's driver."""
    link = DirectLink(**options)
    return link, connect(link)


def active(contact=None, **options):
    link, gripper = reset(**options)
    gripper.activate()
    link.contact, link.writes, link.asked = contact, [], 0
    return link, gripper
