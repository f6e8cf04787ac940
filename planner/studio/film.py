"""Films of simulated parts between the fingers; a page animates the film of one part.

`squeezetree run --world planner.studio.film:make` runs parts as usual, and prints each squeeze as JSON.
"""

import json
from collections.abc import Mapping, Sequence
from math import degrees, dist
from typing import Any

from planner.evaluation.trials import placement_of
from planner.world import ContactWorld, Pose
from runtime.shell.command import say
from runtime.shell.errors import UsageError
from runtime.table import Table, job_of


class Filmed(ContactWorld):
    """The contact world of a job; prints each squeeze as JSON.

    A printed squeeze has its width, and the part's poses before and after it in the hand frame.
    """

    def squeeze(self, pose_hand: Pose) -> tuple[Pose, float, str]:
        """Squeezes the part as the contact world does, and prints the squeeze.

        Returns:
            The final pose in the hand frame, the width [mm] and the status.
        """
        final, width_mm, status = super().squeeze(pose_hand)
        before, after = _pose(*pose_hand), _pose(*final)
        say(json.dumps({"squeezed": {"before": before, "after": after, "width_mm": width_mm}}))
        return final, width_mm, status


make = Filmed  # the world factory


def film(table: Table, parts: Sequence[Mapping[str, Any]], number: str) -> dict[str, Any]:
    """Data of a film: the part's outline, sizes of the fingers, and each squeeze with the hand's pose.

    Args:
        table: the table of the run.
        parts: the simulated parts in the plan's log, each with its `path` and `squeezes`.
        number: number of the part.

    Raises:
        UsageError: there is no such part, or its squeezes are not in the log.
    """
    named = (part for part in parts if str(part["number"]) == number)
    part: Mapping[str, Any] = next(named, {"path": [-1], "squeezes": []})
    nodes = [table.nodes[node].squeeze for node in part["path"] if node in range(len(table.nodes))]
    if not len(nodes) == len(part["path"]) == len(part["squeezes"]):
        raise UsageError(f"part {number}: its squeezes are not in the log; plan once more")
    outline = _outline(table)
    return {
        "outline": outline,
        "reach_mm": max(dist((0.0, 0.0), (point["x_mm"], point["y_mm"])) for point in outline),
        "hand": {
            "opening_mm": table.gripper.opening_um / 1000,
            "length_mm": table.gripper.finger_length_um / 1000,
            "width_mm": table.gripper.finger_width_um / 1000,
        },
        "squeezes": [
            {
                **squeezed,
                "hand": _pose(*placement_of(squeeze)),
                "opening_mm": squeeze.opening_um / 1000,
            }
            for squeeze, squeezed in zip(nodes, part["squeezes"], strict=True)
        ],
    }


def _outline(table: Table) -> list[dict[str, float]]:
    try:
        points = (job_of(table) or {})["part"]["outline_mm"]
        return [{"x_mm": float(x), "y_mm": float(y)} for x, y in points]
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError("the table carries no outline of its part") from error


def _pose(x_mm: float, y_mm: float, theta_rad: float) -> dict[str, float]:
    turn_deg = round(degrees(theta_rad), 2)
    return {"x_mm": round(x_mm, 3), "y_mm": round(y_mm, 3), "turn_deg": turn_deg}
