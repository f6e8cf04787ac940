"""Best-first search of an AND/OR tree of beliefs (AO*, Nilsson 1980), anytime by passes of growing size.

A pass expands the leaves of the best partial plan with the largest probability x value, a few at once, until
none is open, and backs the values up; the best action of any node may change on the way. Expanding ranks
many grasp poses by one squeeze each and then squeezes the node's whole belief at the best few; each becomes
an action, or two at a probable node, whose readings are partitioned by two rules. A pass draws new particles;
each of the last passes draws twice as many as the pass before. Its nodes first try the actions that were best
at the corresponding nodes of the previous pass: so an action is valued by particles that did not choose it.
One early pass keeps the tree instead and expands it below other first squeezes. Fresh trials join the beliefs
of the leaves where they end; leaves that they refute are open again, and the same loop expands them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from planner.arrays import Array, IntArray
from planner.belief.costs import Closing, Hand
from planner.belief.observation import Partition
from planner.belief.particles import Belief, replenish, subsample
from planner.belief.partition import Rule
from planner.belief.recut import recut
from planner.belief.transition import Outcomes, Push, Squeezed
from planner.frames import to_hand
from planner.problem import Problem
from planner.search.actions import LEAST_MODE, MAIN_MODES, actions_of
from planner.search.effort import EFFORTS, PASSES, Effort, Pass
from planner.search.handling import Handling, Opening
from planner.search.proposals import placed, varied
from planner.search.pushes import LEAST_SHARE, Pusher
from planner.search.ranking import Ranking
from planner.search.tree import Action, Node, Origin, Squeeze, breadth_first, dilute, leaves
from planner.work.scheduler import Threads
from runtime.table import MAX_BRANCHES

PROBABLE = 0.01  # nodes of smaller probability try only one action of the previous pass
MARGIN = 0.4  # excess over the best, in squeezes, of actions that are retried
FURTHER = 0.2  # assumed cost of an open leaf beyond the leaf heuristic, in squeezes
REMEMBERED = 24  # recent best grasp poses of other nodes, relative to the part, that a node tries
SPREAD = 2.0, np.radians(5.0)  # standard deviation of variants of the best old grasp poses
VARIANTS = 8
LEAST_PARTICLES = 400  # size up to which a belief is repeated before its next squeeze
RANKING_SHARE = 0.1  # largest share of a job's particles that rank grasp poses
LEAST_GAIN = 0.001  # gain in mode ratio below which a squeeze is without effect
SELECTION_BIAS = 0.5  # selection bias of a branch's mode, in standard deviations of its ratio
MOST_NODES = 1000  # most nodes that a pass expands: under a goal that is too fine, leaves stay open
AT_ONCE = 4  # leaves expanded at once; not the number of cores, which must not change plans
MOST_STALLED = 3  # allowed squeezes in a row without gain: separating two poses may take three
LEAST_OVERLAP = 0.2  # overlap of two histograms of readings from which two nodes are counterparts
MOST_COARSER = 6  # doublings of the price of a branch, to stay below a table's limit
LEAST_STRAYS = 5  # readings far from all branches that form a new one
GROWN = 1.5  # growth of a belief by trials after which a dead end is searched again


class _Candidate(NamedTuple):
    """A grasp pose that may become an action, the pushes before it, and the belief after these."""

    placement: Array
    lying: Belief
    pushes: tuple[Push, ...] = ()
    crashes: float = 0.0  # share of the parts that an open finger would come down on


class Search:
    """The search for one problem.

    Attributes:
        problem: the problem.
        rng: generator of everything but the initial beliefs.
        stage: settings of the pass.
        ranking: ranks grasp poses.
        handling: chooses openings and places of release.
        pusher: proposes pushes; None where the job disables them.
        remembered: the best grasp poses of all nodes so far, each (1, 3) relative to the part.
    """

    def __init__(self, problem: Problem, rng: Generator, stage: Pass = PASSES[0]) -> None:
        self.problem, self.rng, self.stage = problem, rng, stage
        self.ranking = Ranking(problem, actions_of(problem.job))
        self.handling = Handling(problem.job)
        self.pusher = Pusher(problem) if problem.job.actions.pushes else None
        self.remembered = list[Array]()

    def begin(self, stage: Pass, previous: Node | None) -> Node:
        """Begins a pass: returns its root, a belief of new particles unless the pass continues a tree."""
        self.stage, job = stage, self.problem.job
        if stage.explores and previous is not None:
            for child in [child for action in previous.actions or () for child in action.children]:
                child.value = child.value if child.actions else self.leaf_value(child)
            self.back_up(previous)
            return previous
        rng = np.random.default_rng([job.seed, PASSES.index(stage)])
        belief = self.problem.belief(max(1, round(stage.particles * job.search.particles)), rng)
        root = Node(belief, 1.0, self.problem.metric.mode(belief.states), previous=previous)
        root.value = self.leaf_value(root)
        return root

    def grow(self, root: Node, over: Callable[[], bool], progress: Callable[[float], None]) -> bool:
        """The main loop: expands leaves of the best partial plan until none is open, `MOST_NODES` at most.

        Args:
            root: root of the tree, which is modified in place and is a complete plan after each step.
            over: called before each step; returns whether to end.
            progress: called with the share of the parts that is not located yet.

        Returns:
            False if `over` ended the search.
        """
        threads = Threads(self.problem.mixture.workers)
        for _ in range(0, MOST_NODES, AT_ONCE):
            tips = self.due(root)
            if not tips:
                break
            if over() and root.best is not None:  # a plan needs its first squeeze
                return False
            chosen = sorted(tips, key=lambda tip: -tip.share * tip.value)[:AT_ONCE]
            cases = list(zip(chosen, self.rng.spawn(len(chosen)), strict=True))
            for tip, actions in zip(chosen, list(threads.map(self._actions, cases)), strict=True):
                self._expand(tip, actions)
            progress(sum(tip.share for tip in tips))
        return True

    def close(self, node: Node) -> bool:
        """After a pass was cut short, removes the unfinished actions of each node that has a finished action.

        Returns:
            Whether the node is finished, that is, the pass would expand no leaf that remains below it.
        """
        if node.actions is None:
            return not self._is_due(node)
        finished = [each for each in node.actions if all(map(self.close, each.children))]
        node.actions = finished or node.actions
        self._update(node)
        return bool(finished) or not node.actions

    def reopen(self, root: Node) -> None:
        """Reopens leaves that miss the goal and at which no squeeze helped: the next pass tries new ones."""
        for leaf in leaves(root):
            if leaf.actions is not None and not self.problem.stopping.reached(leaf.mode.ratio):
                leaf.actions, leaf.previous = None, None

    def missing(self, root: Node) -> float:
        """The share of parts that end in leaves whose mode ratio is below the goal's confidence."""
        reached = self.problem.stopping.reached
        return sum(leaf.share for leaf in leaves(root) if not reached(leaf.mode.ratio))

    def due(self, root: Node) -> list[Node]:
        """The leaves of the best partial plan that this pass has yet to expand."""
        return [node for node in breadth_first(root) if self._is_due(node)]

    def _is_due(self, node: Node) -> bool:
        """Whether this pass expands a node."""
        return self.is_open(node) and node.share >= self.stage.least

    def is_open(self, node: Node) -> bool:
        """Whether a node is a leaf that misses the goal, or that trials refute, and may be expanded."""
        short = node.refuted or not self.problem.stopping.reached(node.mode.ratio)
        return short and node.actions is None and node.depth < self.problem.job.search.max_depth

    def leaf_value(self, node: Node) -> float:
        """Estimate of the value of a leaf: its cost-to-go [typical squeezes]."""
        stopping, ratio = self.problem.stopping, node.mode.ratio
        back = self.problem.costs.back(node.hand, node.home)
        if not self.is_open(node) and (node.refuted or not stopping.reached(ratio)):
            return back + stopping.failure * (2.0 - ratio)  # the plan gives up all these parts
        # The heuristic distrusts small samples; later passes bring more particles.
        size = len(node.belief) / self.stage.particles**0.5
        left = stopping.cost_to_go(ratio * size, size)
        if not self.is_open(node):
            return back + left
        if node.depth == 1 and self.stage.explores:
            return back + 1.0  # a lower bound: all first actions that may be the best are expanded
        if node.previous and node.previous.actions:
            return node.previous.value
        return back + max(left, 1.0) + FURTHER

    def back_up(self, node: Node | None) -> None:
        """Updates the values of a node and of all above it; their best actions may change."""
        while node is not None:
            self._update(node)
            node = node.parent

    def _update(self, node: Node) -> None:
        """Recomputes the values of a node's actions from those of their children, then the node's value."""
        for action in node.actions or ():
            share = np.array([child.share for child in action.children])
            left = float(share @ [child.value for child in action.children]) / float(share.sum())
            cost, crashes = action.squeeze.cost, action.squeeze.crashes
            action.value = cost + self.problem.stopping.failure * crashes + (1.0 - crashes) * left
        if node.actions:
            node.actions.sort(key=lambda action: action.value)
        node.value = node.actions[0].value if node.actions else self.leaf_value(node)

    def absorb(self, root: Node, ended: dict[int, Belief], strays: dict[int, Belief]) -> float:
        """Adds fresh trials to the beliefs of the leaves where they ended.

        Alternative actions remain at nodes above leaves that fail and cannot be expanded; elsewhere only the
        tried plan remains.

        Args:
            root: the plan that was tried, modified in place.
            ended: the parts that reached each leaf, by the leaf's number.
            strays: the parts whose readings fitted no branch of an inner node, by the node's number.

        Returns:
            The probability of the reopened leaves.
        """
        metric, again, failing = self.problem.metric, 0.0, set[int]()
        inner, ends = [node for node in breadth_first(root) if node.children], leaves(root)
        for number, parts in strays.items():
            self._reach(inner[number], parts)
        for number, here in ended.items():
            node = ends[number]
            if node.actions is not None and len(here) >= (GROWN - 1.0) * len(node.belief):
                node.actions = None
            node.belief, node.fresh = Belief.joined([here, node.belief]), node.fresh + len(here)
            node.mode = metric.mode(node.belief.states)
            hits = int(metric.explained(node.belief[: node.fresh].states, node.mode).sum())
            node.refuted = self.problem.stopping.refuted(hits, node.fresh)
            if node.refuted and self.is_open(node):
                again += node.share
            elif node.refuted:
                while node.parent is not None:
                    node = node.parent
                    failing.add(id(node))
        for node in breadth_first(root):
            if node.actions and id(node) not in failing:
                del node.actions[1:]
        for node in reversed(breadth_first(root)):
            self.back_up(node)
        return again

    def _reach(self, node: Node, strays: Belief) -> None:
        """Extends the branches of a node to the stray readings, which fitted no branch.

        Several readings that are far from all branches become new branches.
        """
        assert node.best is not None
        free, most = self.problem.rule.resolution.free, 2 * self.problem.rule.resolution.margin
        children, clusters = list(node.best.children), node.best.squeeze.clusters
        seen = sum(len(child.belief) for child in children) + len(strays)
        strays = strays[np.argsort(strays.reading, kind="stable")]
        counts = strays.reading[:, None]
        away = np.maximum(clusters.low - counts, counts - clusters.high)
        away = np.where((counts < free) == (clusters.low < free), away, most + 1)
        nearest = np.where(away.min(axis=1) <= most, away.argmin(axis=1), -1)
        for k in np.unique(nearest[nearest >= 0]):
            here, child = strays[nearest == k], children[k]
            child.belief, child.fresh = Belief.joined([here, child.belief]), child.fresh + len(here)
        far = strays[nearest < 0]
        starts = np.flatnonzero((np.diff(far.reading) > most + 1) | (np.diff(far.reading >= free)))
        for rows in np.split(np.arange(len(far)), starts + 1):
            if len(rows) >= LEAST_STRAYS and len(children) < MAX_BRANCHES:
                belief = far[rows]
                mode, share = self.problem.metric.mode(belief.states), node.share * len(rows) / seen
                child = Node(belief, share, mode, node.depth + 1, parent=node, fresh=len(rows))
                child.hand, child.home = children[0].hand, children[0].home
                children.append(child)
        before = node.best.children
        added = sum(child.share for child in children[len(before) :])
        for child in before:
            dilute(child, 1.0 - added / node.share)
        children.sort(key=lambda child: -float(child.belief.reading.mean()))
        _partition(node.best, children)

    def _actions(self, case: tuple[Node, Generator]) -> list[Action]:
        """Squeezes the belief of a leaf at each candidate grasp pose, and returns the resulting actions.

        Args:
            case: the leaf, and the random generator for it.
        """
        node, rng = case
        tried, cases = list[_Candidate](), list[tuple[Belief, Array]]()
        for candidate in self._candidates(node, rng):
            clear = self.handling.clear(candidate.lying, candidate.placement)
            if len(clear):
                tried.append(candidate._replace(crashes=1.0 - len(clear) / len(candidate.lying)))
                cases.append((replenish(clear, LEAST_PARTICLES), candidate.placement))
        squeezed = self.problem.model.squeeze(cases, rng)

        def actions_at(number: int) -> list[Action]:
            candidate, (before, _), after = tried[number], cases[number], squeezed[number]
            jaws = self._jaws(candidate)
            return [
                self._action(node, candidate, jaws, Origin(before, after, rule), outcomes)
                for rule, outcomes in self._partitions(node, after)
            ]

        threads = Threads(self.problem.mixture.workers)
        each = chain.from_iterable(threads.map(actions_at, range(len(cases))))
        actions = [action for action in each if action.children[0].stalled < MOST_STALLED]
        if not actions and node.previous is not None:
            node.previous = None  # the old actions gain nothing here: rank new candidates
            return self._actions(case)
        return actions

    def _expand(self, node: Node, actions: list[Action]) -> None:
        """Turns a leaf into an inner node with these actions, and backs its value up."""
        node.actions = actions
        self.back_up(node)
        # Only one of the squeezes that gain nothing is followed: with all of them the tree would grow
        # exponentially.
        stalled = [action for action in actions if action.children[0].stalled]
        node.actions = [action for action in actions if action not in stalled[1:]]
        if node.best is None:
            return
        if node.depth and node.previous is None:
            self.remembered.append(to_hand(node.best.squeeze.placement[None], node.mode.pose))
        self._split(node)

    def _partitions(self, node: Node, squeezed: Squeezed) -> list[tuple[Rule, Outcomes]]:
        """The partition of the readings by the problem's rule, and at probable nodes a finer one.

        In the finer one, a part that strays costs nothing if another squeeze follows (see `Rule.astray`).
        """
        plain = self._cut(squeezed, self.problem.rule)
        if node.share < self.stage.finer:
            return [plain]
        finer = self._cut(squeezed, self.problem.rule._replace(astray=0.0))
        same = np.array_equal(finer[1].clusters.low, plain[1].clusters.low)
        return [plain] if same else [plain, finer]

    def _jaws(self, candidate: _Candidate) -> Opening:
        """The opening of the jaws before the squeeze of a candidate."""
        pushed = bool(candidate.pushes)
        return self.handling.opening(candidate.lying, candidate.placement, pushed=pushed)

    def _candidates(self, node: Node, rng: Generator) -> list[_Candidate]:
        """Candidates to expand: the best of the previous pass, and the best of many new grasp poses."""
        rows = EFFORTS[-1:] if self.stage.frugal else EFFORTS
        effort = next(row for row in rows if node.share >= row.least)
        old, new, probable = list[_Candidate](), effort.actions, node.share >= PROBABLE
        if node.previous and node.previous.actions:
            cheap = [a for a in node.previous.actions if a.value < node.previous.value + MARGIN]
            old = self._again(node, cheap, self.stage.kept if probable else 1, rng)
            new = min(new, self.stage.new) if probable else 0
        if not new:
            return old
        near = _placements(each for each in old[:2] if not each.pushes)
        grasps = self._ranked(node.belief, node.hand, effort, near, rng)[:new]
        fresh = [_Candidate(grasp, node.belief) for grasp in grasps]
        if self.pusher is not None and node.share >= LEAST_SHARE:
            for pushes in self.pusher.best(node.belief, node.hand, self.ranking, rng):
                lying = self.pusher.pushed(node.belief, pushes, rng)
                _, hand = self.problem.costs.pushes(node.hand, pushes)
                best = self._ranked(lying, hand, effort, near[:0], rng)[:1]
                fresh += [_Candidate(grasp, lying, pushes) for grasp in best]
        return old + [each for each in fresh if not any(_same(each, other) for other in old)]

    def _again(
        self, node: Node, actions: list[Action], most: int, rng: Generator
    ) -> list[_Candidate]:
        """Candidates from the previous pass: distinct grasp poses, and at most one with pushes before it."""
        plain = _placements(a.squeeze for a in actions if not a.squeeze.pushes)
        plain = self.problem.costs.short_way(node.hand, plain)
        plain = self.ranking.unlike(node.belief, plain, most)
        again = [_Candidate(grasp, node.belief) for grasp in plain]
        for squeeze in [a.squeeze for a in actions if a.squeeze.pushes][:1]:
            assert self.pusher is not None
            lying = self.pusher.pushed(node.belief, squeeze.pushes, rng)
            again.append(_Candidate(squeeze.placement, lying, squeeze.pushes))
        return again

    def _ranked(
        self, belief: Belief, hand: Hand | None, effort: Effort, near: Array, rng: Generator
    ) -> Array:
        """Grasp poses (k, 3) for a belief, the best first, without near duplicates.

        Args:
            belief: the belief to squeeze.
            hand: the hand before the squeeze.
            effort: how many grasp poses are tried.
            near: (m, 3) good grasp poses, whose variants are tried, too.
            rng: source of randomness.
        """
        most = min(effort.particles, round(RANKING_SHARE * self.problem.job.search.particles))
        ranking, thin = self.ranking, subsample(belief, most)
        groups = [ranking.candidates(belief, thin)]
        if belief.touched and ranking.actions.proposals:
            groups.append(ranking.free(belief, varied(near, VARIANTS, SPREAD, rng)))
            modes = self.problem.metric.main_modes(thin.states, MAIN_MODES, LEAST_MODE)
            number = PASSES.index(self.stage) if self.stage in PASSES else len(PASSES)
            start, n = number * effort.scattered, effort.scattered // len(modes)  # new in each pass
            for mode in modes:
                about = ranking.actions.proposals[mode.hypothesis[0]].scattered[start : start + n]
                relative = np.concatenate([about, *self.remembered[-REMEMBERED:]])
                groups.append(ranking.free(belief, placed(relative, mode.pose)))
        grasps = self.problem.costs.short_way(hand, np.concatenate(groups))
        if not len(grasps):
            return grasps
        options = ranking.rank(thin, grasps, rng)
        if effort.actions > 1:
            options = ranking.varied(belief, thin, options, rng)
        return ranking.unlike(belief, options.placements, effort.actions)

    def _action(
        self, node: Node, candidate: _Candidate, jaws: Opening, origin: Origin, outcomes: Outcomes
    ) -> Action:
        """The action of a squeeze, with a child for each interval of readings."""
        problem, ratio = self.problem, node.mode.ratio
        grasp, _, pushes, crashes = candidate
        release = self.handling.release(outcomes)
        cost, hand = problem.costs.pushes(node.hand, pushes)
        opening_mm, clearance_mm, contact_mm = jaws
        closing = Closing(opening_mm, contact_mm, outcomes.width_mm)
        cost += problem.costs.squeeze(hand, grasp, closing)
        squeeze = Squeeze(
            grasp, opening_mm, clearance_mm, outcomes.clusters, release, pushes, cost, crashes
        )
        beliefs = self.handling.released(grasp, release, outcomes)
        modes = [problem.metric.mode(belief.states) for belief in beliefs]
        shares = (1.0 - crashes) * outcomes.probability
        chance = SELECTION_BIAS * np.sqrt(len(modes) * ratio * (1.0 - ratio) / len(node.belief))
        gains = shares @ [mode.ratio for mode in modes] - ratio - chance > LEAST_GAIN
        stalled = 0 if gains else node.stalled + 1
        tried = node.previous.actions if node.previous and node.previous.actions else []
        old = [c for a in tried if np.array_equal(a.squeeze.placement, grasp) for c in a.children]
        children, stands = list[Node](), grasp.copy()
        if release is not None:
            stands[:2] = release
        for share, belief, mode in zip((node.share * shares).tolist(), beliefs, modes, strict=True):
            child = Node(belief, share, mode, node.depth + 1, stalled, parent=node)
            child.home = grasp if node.home is None else node.home
            child.hand = Hand(stands, float(problem.encoder.width_mm(belief.reading).mean()))
            child.previous = most_similar(belief, old, problem.rule.resolution.coarsest)
            child.value = self.leaf_value(child)
            children.append(child)
        return Action(squeeze, children, origin=origin)

    def _cut(self, squeezed: Squeezed, rule: Rule) -> tuple[Rule, Outcomes]:
        """Partitions readings into at most as many branches as a table holds.

        No leaf takes a width far from all its readings: a foreign part, or one out of tolerance, may have
        such a width.

        Returns:
            The rule used, in which branches may cost more than in `rule`, and the branches.
        """
        metric = self.problem.metric
        for _ in range(MOST_COARSER + 1):
            outcomes = Outcomes.of(squeezed, rule)
            states = [belief.states for belief in outcomes.beliefs]
            holds = metric.shares(states, metric.modes).sum(axis=1) >= rule.stopping.confidence
            outcomes = outcomes.without_gaps(holds, 2 * rule.resolution.margin)
            if len(outcomes.beliefs) <= MAX_BRANCHES:
                break
            rule = rule._replace(branch=2.0 * rule.branch)
        return rule, outcomes

    def _split(self, node: Node) -> None:
        """Replaces a node by several siblings if its best action shows that its readings should be split.

        The readings of the parent's squeeze were cut into branches before the node's best action was known.
        """
        above, action = node.parent, node.best
        if above is None or above.best is None or node not in above.best.children:
            return
        if action is None or action.origin is None or action.squeeze.pushes:
            return
        cuts = recut(action.origin.before, action.origin.after.belief, self.problem.rule)
        piece = np.searchsorted(cuts, node.belief.reading, side="right")
        numbers, sizes = np.unique(piece, return_counts=True)
        if len(numbers) < 2 or len(above.best.children) + len(numbers) - 1 > MAX_BRANCHES:
            return
        largest, pieces = numbers[np.argmax(sizes)], list[Node]()
        plain = [each for each in node.actions or () if not each.squeeze.pushes]
        for k in numbers[::-1]:  # readings fall as widths rise
            part, share = node.belief[piece == k], node.share * float(np.mean(piece == k))
            mode = self.problem.metric.mode(part.states)
            old = node.previous if k == largest else None
            child = replace(node, belief=part, share=share, mode=mode, actions=None, previous=old)
            child.value = self.leaf_value(child)
            if k == largest and self.is_open(child):
                child.actions = [self._narrowed(child, each, cuts, k) for each in plain]
            pieces.append(child)
        at = above.best.children.index(node)
        _partition(above.best, [*above.best.children[:at], *pieces, *above.best.children[at + 1 :]])
        for child in pieces:
            self.back_up(child)

    def _narrowed(self, node: Node, action: Action, cuts: IntArray, piece: int) -> Action:
        """Restricts an action of a node to the particles of one piece of the node.

        The pieces differ in the readings that led to the node, before the squeeze of the action: `cuts`
        separate these readings, and `piece` is the number of the piece.
        """
        assert action.origin is not None
        before, after, rule = action.origin
        rows = np.searchsorted(cuts, before.reading, side="right") == piece
        squeeze, part = action.squeeze, after._replace(belief=after.belief[rows])
        candidate = _Candidate(squeeze.placement, node.belief, squeeze.pushes, squeeze.crashes)
        rule, outcomes = self._cut(part, rule)
        origin = Origin(before[rows], part, rule)
        return self._action(node, candidate, self._jaws(candidate), origin, outcomes)


def most_similar(belief: Belief, nodes: list[Node], steps: int) -> Node | None:
    """The node whose histogram of readings, in bins of `steps`, overlaps most with that of `belief`.

    None where the overlap is small.
    """

    def histogram(of: Belief) -> Array:
        return np.bincount(of.reading // steps, minlength=bins) / len(of)

    beliefs = [belief, *(node.belief for node in nodes)]
    bins = max(int(each.reading.max()) for each in beliefs) // steps + 1
    here, *there = map(histogram, beliefs)
    common = [float(np.minimum(here, other).sum()) for other in there]
    return nodes[int(np.argmax(common))] if max(common, default=0.0) > LEAST_OVERLAP else None


def _partition(action: Action, children: list[Node]) -> None:
    """Sets the children of an action, in order of ascending width, and the partition of their readings."""
    clusters = Partition.of([child.belief.reading for child in children])
    shares = np.array([child.share for child in children])
    size = np.maximum(1, np.rint(action.squeeze.clusters.size.sum() * shares / shares.sum()))
    action.children = children
    action.squeeze = replace(action.squeeze, clusters=clusters._replace(size=size.astype(np.int64)))


def _placements(squeezes: Iterable[Squeeze | _Candidate]) -> Array:
    """Returns the grasp poses (k, 3) of squeezes."""
    return np.array([each.placement for each in squeezes]).reshape(-1, 3)


def _same(one: _Candidate, other: _Candidate) -> bool:
    """Whether two candidates are the same squeeze after the same number of pushes."""
    alike = np.allclose(one.placement, other.placement)
    return alike and len(one.pushes) == len(other.pushes)
