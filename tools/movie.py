"""Movie of one part that is squeezed until it is located, as an animated SVG (SMIL) for a README."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.evaluation.trials import placement_of
from planner.frames import to_hand, to_world
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.mechanics.simulator import Simulator
from planner.report import canvas, trajectory
from planner.report.replay import Replay
from runtime.table import Table, decide, decision_map, error_mm, poses_of

MU = 0.5
OUTLINES = 30  # most outlines of one belief
ARRIVE_S, CLOSE_S, READ_S, OPEN_S, END_S = 0.5, 1.3, 1.1, 0.4, 2.8
CLOSING = 14  # keyframes of a closing
TOUCH = 0.4  # share of these keyframes before the part moves


class Squeeze(NamedTuple):
    """One squeeze of the shown part."""

    node: int  # index of the table's node
    hand: Array  # (3,) grasp pose in the world [mm, mm, rad]
    states: Array  # (CLOSING, 4) pose of the part in the world, and width, at the keyframes
    reading_um: int  # width as the gripper reads it


class Story(NamedTuple):
    """The path of a part through the table: its squeezes, its leaf and the leaf's error."""

    squeezes: list[Squeeze]
    leaf: int  # index of the leaf
    error_mm: float  # error of the pose that the leaf states


def picture(table: Table, job: Job, beliefs: Replay, squeezes: int = 3) -> str:
    """Returns an SVG of the first replayed part that the table locates by exactly `squeezes` squeezes.

    Raises:
        ValueError: there is no such part.
    """
    simulator = Simulator.of_job(job, workers=1)
    for pose in beliefs.visits[0].before:
        story = followed(table, simulator, pose, squeezes)
        if story is not None:
            return _drawn(table, job, beliefs, story)
    raise ValueError(f"no part is located with {squeezes} squeezes")


def followed(table: Table, simulator: Simulator, pose: Array, squeezes: int) -> Story | None:
    """Simulates how the table locates a part that starts at a pose (3,) in the world.

    The part has the nominal limit surface and the friction `MU`.

    Returns:
        The path of the part through the table; None if the table does not locate the part by exactly
        `squeezes` squeezes, or drags it.
    """
    surface = simulator.nominal(1, MU).surfaces[0]
    profile, target, result = table.gripper.profile, 0, list[Squeeze]()
    while target >= 0 and len(result) < squeezes:
        node = table.nodes[target]
        hand = placement_of(node.squeeze)
        states, _ = simulator.trace(to_hand(pose, hand), surface, MU)
        begun, end = trajectory.touch(states), float(states[-1, 3])
        closing = round(TOUCH * CLOSING)
        until = np.linspace(states[0, 3], begun, closing, endpoint=False)
        widths = np.concatenate([until, np.linspace(begun, end, CLOSING - closing)])
        seen = trajectory.along(states, widths)
        world = np.column_stack([to_world(seen[:, :3], hand), seen[:, 3]])
        read_um = profile.reading_um(profile.step(1e3 * end))
        branch = decide(decision_map(node, table.gripper), read_um, end > 0.0)
        if branch < 0 or node.release is not None:
            return None
        result.append(Squeeze(target, hand, world, read_um))
        pose, target = world[-1, :3], node.branches[branch].target
    if target >= 0 or len(result) < squeezes or not table.leaves[~target].resolved:
        return None
    x, y, angle = map(float, pose)
    answers = poses_of(table.goal, table.leaves[~target])
    off = min(error_mm(table.goal, answer, (x, y, angle)) for answer in answers)
    return Story(result, ~target, off)


class Track(NamedTuple):
    """Keyframes of one animated attribute: its values and their times."""

    times: list[float]  # [s]
    values: list[str]

    def keys(self, total_s: float) -> str:
        """The times as SMIL's `keyTimes`: fractions of `total_s`."""
        return ";".join(f"{min(time / total_s, 1.0):.4f}" for time in self.times)

    def text(self) -> str:
        """The values as SMIL's `values`."""
        return ";".join(self.values)


def _drawn(table: Table, job: Job, beliefs: Replay, story: Story) -> str:
    """Renders the squeezes of a story, one after the other, as an animated SVG."""
    each_s = ARRIVE_S + CLOSE_S + READ_S + OPEN_S
    total_s = each_s * len(story.squeezes) + END_S
    moving, hands = list[tuple[float, Array]](), []
    for k, squeeze in enumerate(story.squeezes):
        begun, opening = k * each_s, table.nodes[squeeze.node].squeeze.opening_um / 1e3
        closing = begun + ARRIVE_S + np.linspace(0.0, CLOSE_S, CLOSING)
        moving += [(begun, squeeze.states[0]), *zip(closing.tolist(), squeeze.states, strict=True)]
        shut_s = float(closing[-1])
        opens_s = shut_s + READ_S
        times = [0.0, begun, *closing.tolist(), opens_s, opens_s + OPEN_S, total_s]
        seen = squeeze.states[:, 3].tolist()
        widths = [opening, opening, *seen, seen[-1], opening, opening]
        hand = {
            "pose": squeeze.hand,
            "upper": Track(times, [f"{0.5 * w:.2f}" for w in widths]),
            "lower": Track(times, [f"{-0.5 * w:.2f}" for w in widths]),
            "seen": _seen(begun, begun + ARRIVE_S, opens_s, opens_s + OPEN_S, total_s),
            "shown": _seen(shut_s, shut_s + 0.2, total_s - 0.3, total_s, total_s),
            "angle": math.degrees(squeeze.hand[2]),
            "width": squeeze.reading_um / 1e3,
            "belief": _belief(beliefs.visits[squeeze.node].before),
            "believed": _seen(max(begun - 0.3, 0.0), begun, shut_s, shut_s + 0.6, total_s),
        }
        hands.append(hand)
    end_s = total_s - END_S
    moving.append((total_s, story.squeezes[-1].states[-1]))
    times = [time for time, _ in moving]
    turns = np.degrees(np.unwrap([state[2] for _, state in moving]))
    leaf = beliefs.leaves[story.leaf]
    jaws = jaws_of(job.gripper)
    text = Path(__file__).with_suffix(".svg").read_text()
    template = canvas.template("tree.svg").environment.from_string(text)
    return template.render(
        job=job,
        total=total_s,
        hands=hands,
        length=jaws.length_mm,
        thickness=jaws.thickness_mm,
        half=0.5 * jaws.opening_mm + jaws.thickness_mm + 1.0,
        error=story.error_mm,
        shift=Track(times, [f"{state[0]:.2f} {state[1]:.2f}" for _, state in moving]),
        turn=Track(times, [f"{angle:.1f}" for angle in turns]),
        colors=vars(canvas),
        leaf={
            "belief": _belief(leaf),
            "seen": _seen(end_s - 0.3, end_s, total_s - 0.3, total_s, total_s),
            "pose": np.array(poses_of(table.goal, table.leaves[story.leaf])[0]),
        },
    )


def _belief(poses: Array) -> dict[str, object]:
    """Returns the values by which the template draws a belief.

    These are at most `OUTLINES` poses of the part, and the opacity of an outline.
    """
    few = subsample(poses, OUTLINES)
    return {"poses": few, "opacity": round(canvas.overlay_opacity(len(few), 0.75), 4)}


def _seen(begin: float, full: float, fading: float, gone: float, total_s: float) -> Track:
    """Keyframes of an opacity: 0 until `begin`, 1 from `full` to `fading`, and 0 from `gone` on."""
    return Track([0.0, begin, full, fading, gone, total_s], ["0", "0", "1", "1", "0", "0"])
