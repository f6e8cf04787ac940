"""A camera under the table of a simulated cell: it sees the part where the world has put it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.sim.camera.cards import Card, lying, tag_cells
from drivers.sim.camera.optics import Array, Optics, webcam
from drivers.sim.camera.render import Flaws, Picture, jpeg, render
from drivers.sim.scene import Pose2
from drivers.sim.tabletop import compose

REFERENCES: tuple[tuple[int, Pose2], ...] = (
    (580, (-150.0, -115.0, 0.0)),
    (581, (150.0, -115.0, 0.5)),
    (582, (150.0, 115.0, -0.9)),
)


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """The camera and all that it sees but the part.

    Attributes:
        optics: the camera.
        flaws: of its pictures.
        number: id of the part's tag.
        side_mm: edge of the tags' black borders.
        on_part: pose of the tag in the part's frame: mm, mm, rad.
        references: fixed tags: id and pose.
    """

    optics: Optics
    flaws: Flaws
    number: int = 7
    side_mm: float = 22.0
    on_part: Pose2 = (0.0, 0.0, 0.0)
    references: tuple[tuple[int, Pose2], ...] = REFERENCES

    def cards(self, part: Pose2 | None) -> list[Card]:
        """All tags; the part's where the part lies."""
        laid = list(self.references)
        if part is not None:
            laid.append((self.number, compose(part, self.on_part)))
        below = bool(self.optics.eye_mm[2] < 0.0)
        return [lying(tag_cells(number), self.side_mm / 8.0, pose, face_down=below) for number, pose in laid]

    def picture(
        self, part: Pose2 | None, rng: np.random.Generator, occluders: tuple[Array, ...] = ()
    ) -> Picture:
        """The picture with the part at a pose, or without it."""
        return render(self.optics, self.cards(part), self.flaws, rng, occluders)

    def taker(self, part: Callable[[], Pose2 | None], seed: int) -> Callable[[], bytes]:
        """What a `CameraServer` takes pictures with.

        Args:
            part: where the part is now.
            seed: of the noise.
        """
        rng = np.random.default_rng([seed, 0x43414D])
        quality = self.flaws.jpeg_quality or 95
        return lambda: jpeg(self.picture(part(), rng), quality)


def standard_rig(flaws: Flaws | None = None) -> Rig:
    """The webcam 600 mm under the middle of the table, not quite level; its pictures compressed once."""
    optics = webcam((6.0, -9.0, -600.0), (1.5, -1.0), 2.0)
    return Rig(optics, flaws or Flaws(jpeg_quality=None))
