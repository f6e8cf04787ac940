"""How thoroughly the search looks: its passes, and the effort at a node by its probability."""

from typing import NamedTuple


class Pass(NamedTuple):
    """The settings of one pass."""

    particles: float  # particles at the root, as a fraction of the job's
    kept: int  # actions of the previous pass that a probable node tries again
    new: int  # further actions that such a node tries
    least: float  # leaves of smaller probability are not expanded
    finer: float  # nodes of at least this probability also try a finer partition of the readings
    work: float  # share of the time of all passes, for progress
    frugal: bool = False  # whether all nodes are expanded as cursorily as improbable ones


class Effort(NamedTuple):
    """How thoroughly a node of at least some probability is expanded."""

    least: float  # probability of the node
    actions: int  # how many it tries
    scattered: int  # grasp poses all about the part that are ranked
    particles: int  # that the ranking uses at most


PASSES = (
    Pass(1 / 8, 0, 0, 0.0005, 2.0, work=0.1, frugal=True),
    Pass(1 / 8, 1, 16, 0.002, 0.5, work=0.25),
    Pass(1 / 4, 8, 8, 0.002, 0.1, work=0.25),
    Pass(1 / 2, 6, 0, 0.002, 0.1, work=0.25),
    Pass(1, 4, 0, 0.002, 0.1, work=0.15),
)
LEAVES = PASSES[-1]._replace(
    kept=1, least=0.0
)  # once fresh trials have come to the leaves of the last pass
EXPLORING = PASSES[1]  # its first actions are followed until they are dearer than another
EFFORTS = (
    Effort(0.5, 16, 192, 400),
    Effort(0.1, 12, 192, 400),
    Effort(0.02, 8, 192, 400),
    Effort(0.004, 4, 96, 400),
    Effort(0.0, 2, 32, 100),
)
FRUGAL = EFFORTS[-1:]
