"""Faults of a simulated cell: their classes and schedules (FAULTS.md)."""

import random
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from runtime.shell import strict_toml
from runtime.shell.errors import InputError, UsageError


class Channel(StrEnum):
    """A kind of events that are counted for each part; the counts say when a fault begins and ends."""

    LINE = "line"  # requests that reach the gripper's end of the line, and their answers
    GRIPPER = "gripper"  # the same requests; the registers or the device itself fail
    ARM = "arm"  # instructions received by the arm's controller
    SCENE = "scene"  # closings of the jaws


class Kind(NamedTuple):
    """A class of faults: its name, its channel, and the ranges of its random parameters."""

    name: str  # name in schedules
    channel: Channel  # channel whose events the fault counts
    low: float  # least `value` in a random schedule
    high: float  # largest `value` in a random schedule
    lasts: int  # longest duration in a random schedule, in events
    meaning: str  # effect of the fault; `value` in it means `Fault.value`


def _kinds(channel: Channel, *rows: tuple[str, float, float, int, str]) -> tuple[Kind, ...]:
    return tuple(Kind(name, channel, *rest) for name, *rest in rows)  # type: ignore[arg-type]


LINE_KINDS = _kinds(
    Channel.LINE,
    ("request_lost", 0, 0, 4, "the gripper does not hear a request"),
    ("reply_lost", 0, 0, 4, "its answer does not arrive; the request was obeyed"),
    ("reply_late", 0.01, 1.6, 2, "the answer comes `value` seconds late"),
    ("reply_twice", 0, 0, 4, "the answer comes twice"),
    ("reply_truncated", 1, 7, 4, "only the first `value` bytes of the answer come"),
    ("reply_corrupted", 0, 63, 4, "bit `value` of the answer is flipped"),
    ("noise", 1, 20, 6, "`value` random bytes come before the answer"),
    ("echo", 0, 0, 60, "the adapter returns the request before the answer"),
    ("wrong_id", 1, 8, 4, "the answer carries slave id `value`"),
    ("unplugged", 0, 0, 1, "the port is gone, for good"),
    ("permission_lost", 0, 0, 1, "the port is gone and may not be opened again"),
)
GRIPPER_KINDS = _kinds(
    Channel.GRIPPER,
    ("flag_stuck", 0, 3, 60, "gOBJ reads `value`"),
    ("flag_late", 0.05, 1.5, 40, "gOBJ follows `value` seconds late"),
    ("flag_false", 1, 3, 4, "gOBJ reads `value` while the jaws still move"),
    ("count_frozen", 0, 0, 60, "gPO stays as it was"),
    ("count_spike", 1, 255, 1, "gPO reads `value` in a single answer"),
    ("encoder_offset", -12, 12, 200, "gPO reads `value` counts too much"),
    ("power_cycle", 0, 0, 1, "the supply fails for a moment: reset, no longer active"),
    ("grip_lost", 0, 0, 1, "what the jaws hold slips out"),
    *(
        (f"gflt_{code:02x}", code, code, 8, f"the gripper reports fault 0x{code:02X}")
        for code in (0x05, 0x07, 0x08, 0x09)
    ),
    *(
        (f"gflt_{code:02x}", code, code, 1, f"major fault 0x{code:02X}: the jaws stop until reset")
        for code in (0x0A, 0x0C, 0x0D, 0x0E)
    ),
    ("gflt_0b", 11, 11, 1, "automatic release 0x0B: the jaws open slowly"),
    ("gflt_0f", 15, 15, 1, "automatic release completed 0x0F: until reset"),
)
ARM_KINDS = _kinds(
    Channel.ARM,
    ("arm_silent", 0, 0, 1, "the RAPID program stops: connection open, nobody answers"),
    ("arm_unreachable", 0, 0, 1, "the controller cannot reach the target: it stops without a word"),
    ("arm_disconnect", 0, 0, 1, "the connection breaks; the motion under way goes on to its end"),
    ("arm_stale_ack", 0, 0, 1, "an acknowledgement of an earlier move comes first"),
    ("arm_refuses", 0, 0, 1, "the instruction is answered as a bad message, nothing moves"),
    ("arm_displaced", 1, 12, 1, "after an instruction the hand is moved `value` mm aside"),
    ("arm_turned", 1, 30, 1, "after an instruction the hand is turned by `value` degrees"),
)
SCENE_KINDS = _kinds(
    Channel.SCENE,
    ("part_missing", 0, 0, 9, "there is no part"),
    ("wrong_part", -8, 12, 9, "another part: every width is `value` mm larger"),
    ("two_parts", 5, 40, 9, "a second part between the jaws, `value` mm thick"),
    ("part_bumped", 2, 30, 1, "the part is pushed `value` mm before the jaws close"),
    ("part_slips", 0, 0, 9, "a part that is lifted slips out"),
    ("camera_covered", 0, 0, 9, "the camera sees nothing"),
    ("camera_moved", 1, 20, 9, "the camera stands `value` mm from its place"),
)
KINDS = {kind.name: kind for kind in (*LINE_KINDS, *GRIPPER_KINDS, *ARM_KINDS, *SCENE_KINDS)}

# Number of a part's first events at which a random fault may begin: about three squeezes.
BEGINS = {Channel.LINE: 150, Channel.GRIPPER: 150, Channel.ARM: 30, Channel.SCENE: 3}


class Fault(NamedTuple):
    """A scheduled fault, in effect from event `at` to `at + length - 1` of a part.

    Events are the events of the fault's channel, counted from 0 for each part.
    """

    kind: str  # name of its `Kind`
    part: int | None = None  # number of the part; None: the fault occurs with every part
    at: int = 0
    length: int = 1
    value: float = 0.0  # parameter, of which `Kind.meaning` says the effect

    @property
    def channel(self) -> Channel:
        """The channel whose events the fault counts."""
        return KINDS[self.kind].channel

    @property
    def code(self) -> int:
        """The gFLT code in the name of the fault; 0 if the name has no code."""
        return int(self.kind.removeprefix("gflt_"), 16) if self.kind.startswith("gflt_") else 0


class Listed:
    """A schedule with a fixed list of faults."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self._faults = tuple(faults)

    def of_part(self, part: int) -> tuple[Fault, ...]:
        """Returns the listed faults of one part."""
        return tuple(fault for fault in self._faults if fault.part in (None, part))


class Seeded(Listed):
    """A random schedule: a part has at most two faults, which depend only on seed and number of the part."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._seed = seed

    def of_part(self, part: int) -> tuple[Fault, ...]:
        """Draws the faults of one part, from the seed and the part's number."""
        draw = random.Random(f"{self._seed}/faults/{part}")
        return tuple(_random_fault(draw, part) for _ in range(draw.choice((0, 0, 1, 1, 1, 2))))


def _random_fault(draw: random.Random, part: int) -> Fault:
    kind = KINDS[draw.choice(list(KINDS))]
    at, length = draw.randrange(BEGINS[kind.channel]), draw.randint(1, kind.lasts)
    value = draw.uniform(kind.low, kind.high)
    if kind.name not in {"reply_late", "flag_late"}:
        value = round(value)
    return Fault(kind.name, part, at, length, value)


class Desk:
    """Tracks a fault schedule: counts the events of each channel, and returns the faults now in effect."""

    def __init__(self, schedule: Listed) -> None:
        self.met: list[str] = []  # names of all faults so far, in order
        self._schedule = schedule
        self.begin(0)

    def begin(self, part: int) -> None:
        """Starts a part: takes its faults from the schedule, and counts its events from 0."""
        faults = self._schedule.of_part(part)
        self._of = {each: [one for one in faults if one.channel is each] for each in Channel}
        self._events = dict.fromkeys(Channel, -1)

    def next(self, channel: Channel) -> None:
        """Counts one more event of a channel; appends to `met` the names of the faults that begin with it."""
        self._events[channel] += 1
        self.met += [fault.kind for fault in self.beginning(channel)]

    def beginning(self, channel: Channel) -> list[Fault]:
        """Returns the faults that begin at the last event of a channel."""
        return [fault for fault in self._of[channel] if fault.at == self._events[channel]]

    def holding(self, channel: Channel) -> list[Fault]:
        """Returns the faults in effect at the last event of a channel."""
        event = self._events[channel]
        return [fault for fault in self._of[channel] if fault.at <= event < fault.at + fault.length]

    def holds(self, kind: str) -> Fault | None:
        """Returns the fault of a kind that is now in effect; None if there is none."""
        held = (fault for fault in self.holding(KINDS[kind].channel) if fault.kind == kind)
        return next(held, None)


def parse(text: str | None) -> Listed:
    """Parses the argument of `--faults`; None: an empty schedule.

    Raises:
        UsageError: the seed is not a whole number.
        InputError: the file cannot be read, or is no schedule.
    """
    if text is None:
        return Listed()
    if text.startswith("seed:"):
        number = text.removeprefix("seed:")
        if not number.isdecimal():
            raise UsageError(f"--faults {text}: write seed:N with a whole number, or name a file")
        return Seeded(int(number))
    path = Path(text)
    try:
        written = strict_toml.parse(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; name a fault schedule, or write seed:N") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not readable as a fault schedule ({error})") from error
    if set(written) - {"fault"} or not isinstance(written.get("fault", []), list):
        raise InputError(f"{path}: write one [[fault]] table a fault, nothing else")
    rows = enumerate(written.get("fault", []), 1)
    return Listed(_written_fault(path, number, row) for number, row in rows)


def _written_fault(path: Path, number: int, row: object) -> Fault:
    where = f"{path}, fault {number}"
    if not isinstance(row, dict) or set(row) - set(Fault._fields):
        raise InputError(f"{where}: the keys are {', '.join(Fault._fields)}")
    if row.get("kind") not in KINDS:
        raise InputError(
            f"{where}: kind {row.get('kind')!r} is unknown; there are {', '.join(KINDS)}"
        )
    counts = [(row.get("part", 0), 0), (row.get("at", 0), 0), (row.get("length", 1), 1)]
    whole = all(type(count) is int and count >= least for count, least in counts)
    if not whole or type(row.get("value", 0.0)) not in (int, float):
        raise InputError(
            f"{where}: part and at are whole numbers from 0, length is one from 1, and value is a number"
        )
    return Fault(**row)
