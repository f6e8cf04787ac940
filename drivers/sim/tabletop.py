"""The part on the table, and what fingers do to it by way of a world."""

import math
import random

from drivers.sim.scene import Pose2, Setting


def compose(a: Pose2, b: Pose2) -> Pose2:
    """Pose b, given in the frame a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return (a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], math.remainder(a[2] + b[2], math.tau))


def relative(a: Pose2, b: Pose2) -> Pose2:
    """Pose b as seen from a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    x, y = b[0] - a[0], b[1] - a[1]
    return (c * x + s * y, c * y - s * x, math.remainder(b[2] - a[2], math.tau))


class TableTop:
    """The part on the table and what the fingers do to it.

    Args:
        setting: what to start from.
        seed: of parts, world and encoder noise.
    """

    def __init__(self, setting: Setting, seed: int) -> None:
        self.geometry = setting.geometry
        self.truthful = setting.truthful
        self._seed = seed
        self._world = setting.factory(setting.subject, seed)
        self._noise = random.Random(f"{seed}/encoder")
        self.part = 0
        self.squeezes = 0
        self.crashes = 0
        self.status = "untouched"
        self.pose = self._lay(0)
        self._coming = (self.pose, self.status)

    def next_part(self) -> int:
        """Put the next part down; its pose depends on seed and number alone."""
        self.part += 1
        self.squeezes = self.crashes = 0
        self.status = "untouched"
        self.pose = self._lay(self.part)
        self._coming = (self.pose, self.status)
        return self.part

    def squeeze(self, hand: Pose2) -> float | None:
        """The fingers start to close: the width at which they will stop, as the encoder sees it, or None.

        The part lies where it lay until `gripped`.
        """
        final, width_mm, status = self._world.squeeze(relative(hand, self.pose))
        self._coming = (compose(hand, final), status)
        if width_mm <= 0.0 or status == "untouched":
            self.gripped()
            return None
        return width_mm + self._noise.gauss(0.0, self.geometry.encoder_noise_mm)

    def gripped(self) -> None:
        """The squeeze is complete: the part lies where the world left it."""
        self.pose, self.status = self._coming
        self.squeezes += 1

    def placed(self, hand: Pose2, opening_mm: float) -> None:
        """Open fingers came down here; standing on the part is a crash."""
        collides = getattr(self._world, "collides", None)
        if collides is not None and collides(relative(hand, self.pose), opening_mm):
            self.crashes += 1

    def truth(self) -> dict[str, object]:
        """What the eye sees."""
        x, y, theta = self.pose if self.truthful else (None, None, None)
        return {
            "x_mm": x,
            "y_mm": y,
            "theta_rad": theta,
            "squeezes": self.squeezes,
            "crashes": self.crashes,
            "status": self.status,
        }

    def _lay(self, part: int) -> Pose2:
        draw = random.Random(f"{self._seed}/part/{part}")
        radius = self.geometry.radius_mm * math.sqrt(draw.random())
        bearing = draw.uniform(-math.pi, math.pi)
        turn = draw.uniform(-self.geometry.halfwidth_rad, self.geometry.halfwidth_rad)
        return (radius * math.cos(bearing), radius * math.sin(bearing), turn)
