"""The paper's Figs 3 and 4, drawn from single squeezes of this planner."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from planner.belief.observation import encoder_of
from planner.job.model import Job
from planner.mechanics.simulator import STATUS_NAMES, Simulator
from planner.paper.subspaces import subspaces_of
from planner.report import canvas, trajectory
from planner.report.paper_figures import FONT, WIDTH_IN, subspaces

# The four ends of the paper's Fig. 3, and poses in the hand frame [mm, mm, rad] that lead to them.
BUTTERFLY_POSES = (
    ("slipped into free space", (19.3, -15.0, 0.7)),
    ("jammed", (-5.7, 12.1, 0.8)),
    ("grasped with offset", (-13.3, -11.5, 1.5)),
    ("grasped with offset", (-0.7, 3.8, 2.7)),
)
MU = 0.5
STATES = ((canvas.BLACK, "before"), (canvas.GREY, "on the way"), (canvas.RED, "at the end"))

SQUEEZES = 8000  # number of squeezes for the subspaces of Fig. 4
# Half the side of the square in which centres of parts start; the fingers miss some of these parts.
SPREAD_MM = 20.0
SEED = 4


def squeezes(job: Job) -> Figure:
    """Draws Fig. 3: single squeezes of the butterfly, with its nominal limit surface and friction `MU`."""
    simulator = Simulator.of_job(job, workers=1)
    surface = simulator.nominal(1, MU).surfaces[0]
    traces = []
    for _, pose in BUTTERFLY_POSES:
        states, status = simulator.trace(np.array(pose), surface, MU)
        traces.append(trajectory.Squeezed(states, STATUS_NAMES[status]))
    result = trajectory.figure(job.part.outline_mm, simulator.jaws, traces)
    result.set_size_inches(WIDTH_IN, 2.95)
    panels = zip(result.axes, traces, BUTTERFLY_POSES, strict=True)
    for k, (axes, trace, (end, _)) in enumerate(panels):
        title = f"({chr(97 + k)}) {end}\nwidth {trace.states[-1, 3]:.1f} mm"
        axes.set_title(title, fontsize=FONT, pad=4.0)
    signs = [Line2D([], [], color=color, label=name) for color, name in STATES]
    style = {"color": canvas.BLUE, "marker": "+", "linestyle": "none"}
    signs.append(Line2D([], [], label="centre of mass, every 1.5 mm", **style))
    result.legend(handles=signs, loc="outside upper center", ncols=4, frameon=False, fontsize=FONT)
    return result


def partition(job: Job, names: Sequence[str]) -> Figure:
    """Draws Fig. 4 for the part and the gripper of a job: the subspaces that the width distinguishes.

    `names` are the names of the subspaces: free space first, the others in the order of their widths.

    Raises:
        ValueError: the numbers of subspaces and of names differ.
    """
    simulator = Simulator.of_job(job, workers=1)
    rng = np.random.default_rng(SEED)
    poses = rng.uniform([-SPREAD_MM, -SPREAD_MM, 0.0], [SPREAD_MM, SPREAD_MM, np.pi], (SQUEEZES, 3))
    rolled = simulator.roll_out(poses, simulator.sample(SQUEEZES, rng))
    # Jaws that stay open: a finger would have stood on the part.
    open_jaws = rolled.width_mm >= simulator.jaws.opening_mm
    final, width_mm = rolled.poses[~open_jaws], rolled.width_mm[~open_jaws]
    result = subspaces_of(width_mm, encoder_of(job))
    if len(result) != len(names):
        raise ValueError(f"{len(result)} subspaces, but {len(names)} names for them")
    shares = 100 * result.size / result.size.sum()
    lines = [f"{shares[0]:.0f} % of squeezes"]
    gripped = zip(result.mean_mm[1:], shares[1:], strict=True)
    lines += [f"{mean:.1f} mm, {share:.0f} % of squeezes" for mean, share in gripped]
    titles = [f"{name}\n{words}" for name, words in zip(names, lines, strict=True)]
    labels, outline_mm = result.label(width_mm), job.part.outline_mm
    return subspaces(result, labels, final, outline_mm, simulator.jaws, titles)
