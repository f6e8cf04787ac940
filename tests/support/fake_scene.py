"""Settings of simulated cells for tests in which neither table nor job matters: any squeeze reads 21 mm."""

import math
from dataclasses import replace

from drivers.sim.physics.scene import Geometry, Setting
from runtime.table import PROFILES

GEOMETRY = Geometry(
    gripper=replace(PROFILES["robotiq-2f-85"], noise_um=0),
    squeeze_height_mm=10.0,
    retreat_height_mm=60.0,
    radius_mm=5.0,
    halfwidth_rad=math.pi,
)


class FakeWorld:
    """A world in which each squeeze aligns the part with the fingers and centres it, at a width of 21 mm."""

    width_mm = 21.0

    def squeeze(self, pose_hand):
        return (pose_hand[0], 0.0, 0.0), self.width_mm, "grasped"

    def collides(self, pose_hand, opening_mm):
        return abs(pose_hand[1]) > opening_mm / 2.0 - self.width_mm


def setting(world=None):
    """Returns the setting of a simulated cell without a table; its world is by default a `FakeWorld`."""
    return Setting(None, GEOMETRY, "fake", lambda job, seed: world or FakeWorld())


# Factories of worlds, which tests name with `--world`.


def make(job, seed):
    return FakeWorld()


def broken(job, seed):
    raise RuntimeError("this world\nis broken")


class Stumbling:
    """A world whose first instance works, so that the cell can warm up; later instances fail to squeeze."""

    instances = 0

    def __init__(self):
        Stumbling.instances += 1
        self.fails = Stumbling.instances > 1

    def squeeze(self, pose_hand):
        if self.fails:
            raise RuntimeError("no such squeeze")
        return pose_hand, 0.0, "untouched"


def stumbling(job, seed):
    return Stumbling()


not_callable = 3
