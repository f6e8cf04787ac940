"""What the search is to reach, and the numbers that trade planning time for the quality of the plan."""

from dataclasses import dataclass
from typing import NamedTuple

from planner.belief.metric import Metric
from planner.belief.observation import Resolution
from planner.belief.partition import Estimate, Rule
from planner.belief.transition import Costs


@dataclass(frozen=True, slots=True)
class SearchParams:
    """Settings of the search. "Share" is that of all parts where nothing else is said."""

    least_clearance_mm: float = 0.5
    """Open fingers are never planned nearer to a believed part than this."""

    scattered: int = 256
    """Hands all about a belief's modes that are tried, besides the job's own and those along stable sides."""
    varied: int = 4
    """Variants of each of the actions to be followed, in each of two rounds."""
    followed: int = 4
    """Unlike actions of each group followed beyond their first squeeze: more takes longer."""
    finalists: int = 8
    """Actions of a belief that all its particles judge; of more, half are dropped after each round."""
    first_share: float = 0.125
    """Share of the particles that judge in the first round; each round judges by twice as many."""
    first_particles: int = 16
    """The least number of them."""
    nearly_done: float = 0.5
    """Squeezes left after the best action, below which no action of the belief is followed further."""
    full_effort_share: float = 0.2
    """Share from which a belief is searched with all the particles and hands allowed; below, with fewer."""
    least_effort: float = 0.25
    """Fraction of those that the smallest share keeps."""
    deeper_share: float = 0.002
    """Share of a belief from which one squeeze more is looked ahead where nothing gains."""
    thorough_share: float = 0.0005
    """The same for all the scattered hands, with as many particles as it takes to see those outside."""
    few_poses: float = 0.9
    """Share of a belief at as many poses as a prediction names and one more, from which these are few."""
    hard: float = 1.0
    """Squeezes that the best action of such a belief may leave beyond J of the belief, before more is tried:
    where hands that tell are rare, few particles take the first that seems to gain for one."""
    outside_particles: int = 20
    """Particles outside the mode needed to see whether a squeeze separates them from the rest."""
    rescored: int = 6
    """Last squeezes scored again with that many particles."""

    least_gain: float = 0.001
    """Gain in mode ratio below which no squeeze is planned."""
    second_mode: float = 0.25
    """Weight of a second pose that explains a belief, relative to the first, where actions are ranked."""
    dead_end: float = 10.0
    """Squeezes charged, times the mass outside, where no squeeze gains at the end of a look-ahead."""
    shrinkage: float = 1.0
    """Particles of a child belief assumed to lie outside its mode: small samples look too pure."""
    doubt: float = 0.05
    """Chance that a part near a cut strays: more makes fewer wrong if encoders are off, and more squeezes."""
    astray: float = 0.3
    """Squeezes that such a part costs in a branch that is squeezed again: likewise."""
    reach: float = 2.7
    """Counts from a cut that are near it: more asks for wider gaps between branches."""
    branch: float = 8.0
    """Squeezes of one particle that a branch must save: more makes smaller tables, less follows noise."""
    selection_bias: float = 0.5
    """Standard deviations of the mode ratio that each cluster's mode gains by being chosen for it."""

    alternatives: int = 2
    """Placements kept for a node besides the chosen one."""
    alike_mm: float = 6.0
    alike_deg: float = 20.0
    """Placements nearer than both are variants of one."""
    alternative_excess: float = 0.5
    """Squeezes that an alternative may seem to cost more than the best."""
    first_excess: float = 0.05
    """The same of the first squeeze, whose alternatives are whole trees."""
    first_candidates: int = 8
    """First squeezes that hasty trees are grown for."""
    close: float = 0.3
    """Squeezes a part by which a squeeze's hasty tree may cost more than the cheapest, to be judged by
    another: two of one squeeze differ by 0.1 to 0.3."""
    undecided: float = 0.15
    """Squeezes a part by which the mean of both may be more, for a careful tree to be grown, too."""
    most_without_gain: int = 3
    """Squeezes in a row that may gain nothing: two or three may be needed to tell two poses apart."""
    least_loss: float = 0.002
    """Mode ratio that an exhausted leaf must have lost before squeezes are searched again."""
    searched_again: float = 1.5
    """The same of its belief's size, in units of that which was searched: more particles show rarer poses."""
    least_particles: int = 100
    """A smaller belief is repeated before its next squeeze."""

    improved_savings: tuple[tuple[int, float], ...] = ((1, 0.15), (2, 0.3))
    """Depths of the nodes whose alternatives are tried, in this order, and the least squeezes a part beyond
    the one needed that are left there."""
    improved_share: float = 0.02
    """Least share of a node whose alternatives are tried; what locates all but less is grown after that."""
    piece_particles: int = 1500
    """Particles of the pieces that such a node is cut into, to see whether its readings had better be told
    apart: with fewer its leaves seem better than they are."""
    least_pieces: int = 3
    """So many of them at least: fewer have never saved enough."""
    piece_saving: float = 0.2
    """Fraction of the price that this must save: trees of more pieces seem up to 15 % cheaper than they
    are."""
    rough: float = 0.03
    """Share of such a node, of which leaves that locate all but less cost J while its subtrees are compared:
    they hold half the work."""
    dearer: float = 0.1
    """Squeezes a part by which an alternative may seem to cost more while it grows: J errs by about that."""

    reopen_margin: float = 0.75
    """Fraction of the goal's allowed errors above which a leaf is grown further: the rest is reserve."""
    step_mm: float = 0.8
    """Closing step of the tree's own squeezes, twice that of the trials: all but one in 1000 end within 0.3
    mm and 1 degree of where steps of 0.05 mm do."""
    ahead_step_mm: float = 1.6
    """The same of squeezes only looked ahead: all but two in 1000 do."""
    refinements: int = 6
    """How often leaves are grown further that miss the goal."""
    looks: int = 3
    """How often new parts are drawn to judge a tree: those that came to leaves grown since are carried on."""
    leaf_trials: int = 100
    """Trials of a leaf from which its success rate itself is compared with the goal: by the exact test alone,
    leaves just below it stay, and fresh trials refute them once nothing is grown any more (clevis: 2 %)."""
    least_short: float = 0.0005
    """Share in leaves that miss the goal, from which they are grown further; below, they stay unresolved."""

    def rule(self, metric: Metric, estimate: Estimate, resolution: Resolution) -> Rule:
        """How readings are cut for a goal, given J of a belief and what an encoder tells apart."""
        return Rule(metric, estimate, resolution, self.doubt, self.astray, self.branch, self.reach)


class Objective(NamedTuple):
    """What a plan is to reach.

    Attributes:
        rule: how readings are cut into branches; knows the goal and J of a belief.
        costs: c of a squeeze.
        params: settings of the search.
    """

    rule: Rule
    costs: Costs
    params: SearchParams = SearchParams()

    @property
    def metric(self) -> Metric:
        """The goal."""
        return self.rule.metric

    @property
    def confidence(self) -> float:
        """Mode ratio at which a belief needs no further squeeze."""
        return self.rule.estimate.confidence
