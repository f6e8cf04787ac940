"""Effort of the search: the settings of each pass, and the effort at a node, which its probability sets."""

from typing import NamedTuple


class Pass(NamedTuple):
    """The settings of one pass."""

    particles: float  # particles at the root, as a fraction of the job's
    kept: int  # actions of the previous pass that a probable node retries
    new: int  # further actions that such a node tries
    least: float  # leaves of smaller probability are not expanded
    finer: float  # least probability of nodes that also try a finer partition of the readings
    work: float  # share of the time of all passes, for progress
    frugal: bool = False  # whether all nodes are expanded with the low effort of improbable ones
    # Whether the pass continues the tree of the previous pass, and expands all first squeezes that may be the
    # best.
    explores: bool = False


class Effort(NamedTuple):
    """Effort of expanding a node whose probability is at least `least`."""

    least: float  # probability of the node
    actions: int  # number of actions tried
    scattered: int  # scattered grasp poses that are ranked
    particles: int  # most particles in the ranking


PASSES = (
    Pass(1 / 8, 0, 0, 0.0005, 2.0, work=0.11, frugal=True),
    Pass(1 / 8, 1, 16, 0.002, 0.5, work=0.18),
    Pass(1 / 8, 1, 16, 0.002, 0.5, work=0.09, explores=True),
    Pass(1 / 4, 8, 8, 0.002, 0.1, work=0.17),
    Pass(1 / 2, 6, 0, 0.002, 0.1, work=0.25),
    Pass(1, 4, 0, 0.002, 0.1, work=0.20),
)
REPAIR = PASSES[-1]._replace(kept=1, least=0.0)  # pass that repairs refuted leaves
EFFORTS = (
    Effort(0.5, 16, 192, 400),
    Effort(0.1, 12, 192, 400),
    Effort(0.02, 8, 192, 400),
    Effort(0.004, 4, 96, 400),
    Effort(0.0, 2, 32, 100),
)
