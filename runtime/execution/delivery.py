"""Delivery of a localised part: where it is grasped for the last time, and where it is put down.

A delivery is stated in a job's section `delivery`, in a TOML file with the same keys (OUTCOMES.md), or on the
command line.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from runtime.shell import strict_toml
from runtime.shell.errors import InputError, UsageError
from runtime.table import Area, Pose2, Table
from runtime.traversal.answer import frames_in, frames_of

# how many numbers a key takes; 0: one, not in a list
NUMBERS = {"drop": 3, "width_mm": 0, "area_mm": 4}
KEYS = (*NUMBERS, "grasp")
# tolerance of a stated width at the grasp, for errors of encoder and contour
WIDTH_TOLERANCE_MM = 1.5
LARGEST = 10_000.0  # mm or degrees; larger than any cell


@dataclass(frozen=True, slots=True)
class Delivery:
    """Where a localised part is taken and put down."""

    drop: Pose2  # pose of the part in the world, mm, mm, rad
    grasp: Pose2 = (0.0, 0.0, 0.0)  # pose of the hand in the part's frame, mm, mm, rad
    # least and greatest width that the fingers may read at the grasp
    width_mm: tuple[float, float] = (0.5, math.inf)
    # x min, y min, x max, y max of the hand while it carries, um; None for the work area
    area_um: Area | None = None

    def record(self) -> dict[str, object]:
        """The delivery as an entry of a journal's header; an unlimited width is stated as None."""
        low, high = self.width_mm
        return {
            "drop": list(self.drop),
            "grasp": list(self.grasp),
            "width_mm": [low, high if math.isfinite(high) else None],
            "area_um": None if self.area_um is None else list(self.area_um),
        }

    def of(self, hypothesis: int) -> Self:  # noqa: ARG002
        """Returns this delivery for any hypothesis, since there is only one part."""
        return self

    def each(self) -> list[tuple[str, Self]]:
        """A list of one pair: the words by which messages name the part, and this delivery."""
        return [("the part", self)]


@dataclass(frozen=True, slots=True)
class Sorting:
    """Where each of several parts is put down; a part without an entry stays where it lies."""

    named: Mapping[str, Delivery]
    numbers: Mapping[int, str]  # names of the parts, by hypothesis

    def record(self) -> dict[str, object]:
        """The deliveries, by the part's name, as an entry of a journal's header."""
        return {name: place.record() for name, place in self.named.items()}

    def of(self, hypothesis: int) -> Delivery | None:
        """The delivery of the part with this index (hypothesis); None if that part stays where it lies."""
        return self.named.get(self.numbers[hypothesis])

    def each(self) -> list[tuple[str, Delivery]]:
        """Returns pairs of a part's name and its delivery."""
        return list(self.named.items())


Places = Delivery | Sorting  # where the parts of a run are put down


def from_word(word: str, picks: Mapping[str, Pose2]) -> Delivery:
    """Parses the value of `--deliver`: `x,y,angle` (see `from_text`), or a file's name (see `from_file`).

    `picks` are the part's named grasps, of which a file may name one.
    """
    return from_text(word) if "," in word else from_file(Path(word), picks)


def from_text(text: str) -> Delivery:
    """Parses `x,y,angle`, the pose of the part where it is put down: mm, mm, degrees.

    Raises:
        UsageError: the text is not three numbers.
        InputError: a number is larger than any cell.
    """
    try:
        x_mm, y_mm, angle_deg = (float(word) for word in text.split(","))
    except ValueError:
        raise UsageError(
            f"--deliver {text!r}: write x,y,angle in mm, mm and degrees, or a file"
        ) from None
    return from_keys({"drop": [x_mm, y_mm, angle_deg]}, "--deliver", {})


def by_name(words: Sequence[str], table: Table) -> Sorting:
    """Parses the values `NAME=x,y,angle` or `NAME=FILE` of `--deliver`, for a table of several parts.

    Raises:
        UsageError: a name is missing, unknown or repeated; a place is invalid; or the table does not tell
            both which part it is and where it lies.
        InputError: see `from_file`.
    """
    goal, numbers = table.goal, dict(enumerate(hypothesis.name for hypothesis in table.hypotheses))
    parts = zip(numbers.values(), frames_of(table), strict=True)
    picks = {name: frames.picks for name, frames in parts}
    if goal.kind == "identity" or not goal.identify:
        raise UsageError(
            "--deliver: this table does not tell both which part it is and where it lies"
        )
    result: dict[str, Delivery] = {}
    for word in words:
        name, sign, place = word.rpartition("=")
        if not sign or name not in numbers.values():
            known = ", ".join(numbers.values())
            raise UsageError(
                f"--deliver {word!r}: the table leaves open which part it is; write NAME=x,y,angle, the name "
                f"one of: {known}"
            )
        if name in result:
            raise UsageError(f"--deliver {word!r}: {name} has a place already; give each part one")
        result[name] = from_word(place, picks[name])
    return Sorting(result, numbers)


def from_file(path: Path, picks: Mapping[str, Pose2]) -> Delivery:
    """Reads a delivery from a TOML file, whose keys are at the top level or in a section `delivery`.

    `picks` are the part's named grasps, of which the file may name one.

    Raises:
        InputError: the file cannot be read, or a key is wrong.
    """
    try:
        with path.open("rb") as file:
            document = strict_toml.parse(file.read(strict_toml.MOST_BYTES + 1).decode())
    except OSError as error:
        raise InputError(
            f"--deliver {path}: {error.strerror or error}; name a TOML file"
        ) from error
    except ValueError as error:
        raise InputError(f"--deliver {path}: no TOML file ({error})") from error
    return from_keys(document.get("delivery", document), f"--deliver {path}", picks)


def from_job(job: Mapping[str, object] | None) -> Delivery | None:
    """The delivery of a table's embedded job (`runtime.table.job_of`), None if the job has none.

    Raises:
        InputError: a key of the delivery is wrong.
    """
    keys = (job or {}).get("delivery")
    if keys is None:
        return None
    return from_keys(keys, "the job's section delivery", frames_in((job or {}).get("part")).picks)


def from_keys(keys: object, where: str, picks: Mapping[str, Pose2]) -> Delivery:
    """Builds a delivery from the keys of a section `delivery`.

    Args:
        keys: the section, parsed.
        where: what messages call the section.
        picks: named grasps: poses of the hand in the part's frame.

    Raises:
        InputError: `keys` is no section; a key is unknown or missing; a value is wrong; or the grasp is none
            of the picks.
    """
    if not isinstance(keys, Mapping):
        raise InputError(f"{where}: delivery is no section of keys and values")
    if unknown := keys.keys() - {*KEYS}:
        raise InputError(f"{where}: unknown key {sorted(unknown)[0]}; known are {', '.join(KEYS)}")
    if "drop" not in keys:
        raise InputError(f"{where}: drop is missing; say where the part goes: [x, y, angle]")
    numbers = {name: _numbers(where, name, keys[name]) for name in NUMBERS if name in keys}
    x_mm, y_mm, angle_deg = numbers["drop"]
    delivery = Delivery((x_mm, y_mm, math.radians(angle_deg)))
    if (grasp := keys.get("grasp")) is not None:
        if not isinstance(grasp, str) or grasp not in picks:
            known = ", ".join(picks) or "none"
            raise InputError(f"{where}: grasp {grasp!r} is none of [part] picks: {known}")
        delivery = replace(delivery, grasp=picks[grasp])
    if "width_mm" in numbers:
        width = numbers["width_mm"][0]
        held = (width - WIDTH_TOLERANCE_MM, width + WIDTH_TOLERANCE_MM)
        delivery = replace(delivery, width_mm=held)
    if "area_mm" in numbers:
        x_min, y_min, x_max, y_max = (round(1000 * value) for value in numbers["area_mm"])
        if x_min >= x_max or y_min >= y_max:
            raise InputError(
                f"{where}: area_mm is x min, y min, x max, y max, each min below its max"
            )
        delivery = replace(delivery, area_um=Area(x_min, y_min, x_max, y_max))
    return delivery


def _numbers(where: str, name: str, value: object) -> tuple[float, ...]:
    items: list[object] = value if isinstance(value, list) else [value]
    wanted = NUMBERS[name]
    if isinstance(value, list) != bool(wanted) or len(items) != max(wanted, 1):
        raise InputError(f"{where}: {name} takes {wanted or 'one'} number{'s' if wanted else ''}")
    numbers = []
    for item in items:
        if isinstance(item, bool) or not isinstance(item, int | float) or item != item:
            raise InputError(f"{where}: {name} holds {item!r}, which is no number")
        if not -LARGEST <= item <= LARGEST:
            raise InputError(
                f"{where}: {name} holds a number beyond {LARGEST:g}; these are mm and degrees"
            )
        numbers.append(float(item))
    return tuple(numbers)
