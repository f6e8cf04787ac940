"""A camera under the table of a simulated cell, which sees the part at its true pose."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drivers.planar import Pose2, compose
from drivers.sim.camera.cards import Card, lying, tag_cells
from drivers.sim.camera.optics import Optics, webcam
from drivers.sim.camera.render import Flaws, Picture, jpeg, render
from drivers.sim.physics.tabletop import Look

REFERENCES: tuple[tuple[int, Pose2], ...] = (
    (580, (-150.0, -115.0, 0.0)),
    (581, (150.0, -115.0, 0.5)),
    (582, (150.0, 115.0, -0.9)),
)


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """The camera and everything in its view except the part."""

    optics: Optics  # the camera
    flaws: Flaws  # flaws of the camera's pictures
    # Id of the part's tag. With several parts, their tags have consecutive ids from this one on.
    number: int = 7
    side_mm: float = 22.0  # edge of the tags' black borders
    on_part: Pose2 = (0.0, 0.0, 0.0)  # pose of the tag in the part's frame: mm, mm, rad
    references: tuple[tuple[int, Pose2], ...] = REFERENCES  # fixed tags: id and pose

    @property
    def below(self) -> bool:
        """Whether the camera looks up through the table."""
        return bool(self.optics.eye_mm[2] < 0.0)

    def cards(self, part: Pose2 | None, number: int | None = None) -> list[Card]:
        """Cards of all tags: the fixed tags and, if the pose of the part is given, the part's tag.

        `number` is the id of the part's tag; by default the id that the rig states.
        """
        laid = list(self.references)
        if part is not None:
            laid.append((self.number if number is None else number, compose(part, self.on_part)))
        return [self.card(number, pose) for number, pose in laid]

    def card(self, number: int, pose: Pose2) -> Card:
        """Card of one tag at a pose."""
        return lying(tag_cells(number), self.side_mm / 8.0, pose, face_down=self.below)

    def watcher(self, look: Callable[[], Look], seed: int) -> Callable[[], bytes]:
        """Returns a function that takes a picture of `look()`, with noise by `seed`, as a JPEG file."""
        rng = np.random.default_rng([seed, 0x43414D])
        quality = self.flaws.jpeg_quality or 95
        _ = self.optics.corner_rays  # computed once, before the first request
        return lambda: jpeg(self.seen(look(), rng), quality)

    def seen(self, look: Look, rng: np.random.Generator) -> Picture:
        """Renders the picture of what the camera has in view.

        A foreign part carries the tag with the id before `self.number`, which no other part carries.
        """
        if look.covered:
            return render(self.optics, [], replace(self.flaws, gain=0.0), rng)
        number = self.number + look.hypothesis
        cards = self.cards(look.pose, self.number - 1 if look.strange else number)
        if look.second is not None:
            cards.append(self.card(number, compose(look.second, self.on_part)))
        optics = self.optics.moved(look.moved_mm, 0.0) if look.moved_mm else self.optics
        return render(optics, cards, self.flaws, rng)


def standard_rig() -> Rig:
    """Creates a rig with a webcam 600 mm under the table; camera and tag are slightly out of place.

    The camera is tilted, and the tag is shifted and turned on the part.
    """
    optics = webcam((6.0, -9.0, -600.0), (1.5, -1.0), 2.0)
    return Rig(optics, Flaws(jpeg_quality=None), on_part=(2.0, -1.0, 0.3))
