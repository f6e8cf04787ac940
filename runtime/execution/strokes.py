"""Strokes of a closing motion, which take the jaws from one opening to another.

Jaws close at full speed to just before the first contact that the belief allows, then at the squeeze's
speed. A regulated squeeze (the paper's experiment 8*) closes with the least force until contact, and raises
it only where that has an effect.
"""

from math import ceil
from typing import NamedTuple

from drivers.ports import GripperProfile
from runtime.execution.handling import Handling
from runtime.execution.reading import CLOSED_UM
from runtime.table import PPM, Branch, Calibration, Node, Squeeze, Timing

# Largest step of the force between two readings: a quarter of its range, and its rounding.
RAISE_SHARE = 0.251


class Stroke(NamedTuple):
    """One motion of the jaws."""

    request_um: int  # target, `CLOSED_UM` for as far as they go
    speed_mm_s: float
    force_n: float
    advance_mm: float  # largest advance of the tips during the stroke, by which the arm is raised


def closing(
    node: Node, handling: Handling, calibration: Calibration, open_mm: float, timing: Timing
) -> list[Stroke]:
    """The strokes, at least one, by which the jaws close at a node; the last stroke closes them fully.

    At first the jaws are open by `open_mm`. A regulated squeeze closes with the least force until contact;
    `raising` gives the forces after contact.
    """
    squeeze, profile, arc = node.squeeze, calibration.profile, handling.arc
    regulated = _is_regulated(squeeze, handling, profile)
    force = profile.force_n[0] if regulated else squeeze.force_mn / 1000
    slow = squeeze.speed_um_s / 1000
    fast = max(slow, timing.fastest_mm_s)
    contact_um = node.contact_um if handling.approaches else None
    contact_mm = None if contact_um is None else contact_um / 1000
    near_mm = timing.approach_mm(open_mm, contact_mm, squeeze.speed_um_s / 1000)
    ends = [0.0] if arc is None else arc.stages(open_mm, 0.0)
    if near_mm < open_mm:
        ends = sorted({*ends, near_mm}, reverse=True)
    strokes: list[Stroke] = []
    start_mm, start_um = open_mm, calibration.nearest_um(round(1000 * open_mm))
    for end_mm in ends:
        request = calibration.nearest_um(round(1000 * end_mm)) if end_mm > 0.0 else CLOSED_UM
        if request == start_um:  # two ends within one step
            continue
        speed = fast if near_mm <= end_mm < open_mm else slow
        advance_mm = 0.0 if arc is None else arc.most_mm(end_mm, start_mm)
        strokes.append(Stroke(request, speed, force, advance_mm))
        start_mm, start_um = end_mm, request
    return strokes


def of_any_width(node: Node, squeeze: Squeeze, widest_um: int) -> Node:
    """A copy of the node with another squeeze, and with one branch that takes any width up to `widest_um`."""
    return node._replace(squeeze=squeeze, branches=(Branch(0, 0, widest_um, PPM, ~0),))


def raising(squeeze: Squeeze, handling: Handling, profile: GripperProfile) -> list[float]:
    """The rising forces [N] that a regulated squeeze requests after contact, the squeeze's force last.

    The list is empty for a squeeze that is not regulated.
    """
    if not _is_regulated(squeeze, handling, profile):
        return []
    (least, most), last = profile.force_n, squeeze.force_mn / 1000
    step = RAISE_SHARE * (most - least)
    return [*(least + step * k for k in range(1, ceil((last - least) / step))), last]


def _is_regulated(squeeze: Squeeze, handling: Handling, profile: GripperProfile) -> bool:
    """Whether a squeeze is regulated: `handling` says so, and the force exceeds the gripper's least force."""
    return handling.regulated and squeeze.force_mn > round(1000 * profile.force_n[0])
