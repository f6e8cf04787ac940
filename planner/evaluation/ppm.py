"""Rates of rare wrong answers of a table in parts per million, with upper bounds, from millions of trials.

A study runs in chunks of trials, and adds up their outcomes. The outcomes of a chunk do not depend on the
worker that runs it, so that a study may continue from the saved sums of earlier chunks.

Importance splitting (Kahn and Harris 1951) follows a part that reaches a rare node as several copies of equal
weight. Each copy draws the mechanics of its further squeezes afresh: sums of weights stay unbiased, and many
more outcomes judge a rare leaf. Numbers of copies are powers of two, so that sums of weights are exact.

The bounds require only that parts are independent, and that the weight of a part's wrong copies lies between
0 and 1. Both hold for any splitting.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from operator import add
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.special import betaln, xlog1py, xlogy

from planner.arrays import Array, IntArray
from planner.evaluation.disturbance import Disturbance
from planner.evaluation.outcome import CRASHED
from planner.evaluation.trials import Cell, Program
from planner.job.model import Job
from planner.work.scheduler import Scheduler
from planner.world import Worlds
from runtime.shell import strict_json
from runtime.shell.errors import InputError
from runtime.shell.files import writing
from runtime.table import PPM, Table

CHUNK = 10_000
SEED_PPM = 0x50504D
ERROR = 0.05
"""Probability that a bound is ever wrong, however often a study is looked at and continued."""
PRIOR = 0.5, 1e4
"""Parameters of the beta mixture: bounds are tightest for rates about 50 ppm, which integrators ask for."""
SPLIT_BELOW = 0.004
"""Share of all parts that reach a node, below which the node is rare and its parts are split into copies."""
MOST_COPIES = 64
MOST_ROWS = 8


class Sums(NamedTuple):
    """Weighted counts of outcomes over many parts; the weights of one part's copies add up to 1."""

    parts: int  # number of parts
    visits: Array  # (L,) weight that ended in each leaf
    wrong: Array  # (L,) weight answered wrongly in each resolved leaf
    # (L + 1,) for each leaf, the sum over parts of the squared wrong weight; last: for all leaves together.
    squares: Array
    rejected: float  # weight of parts whose width fitted no branch
    crashed: float  # weight of parts that an open finger came down on, so that the arm stopped
    squeezes: float  # weighted number of squeezes

    @classmethod
    def none(cls, leaves: int) -> Self:
        """Empty sums, for a table of `leaves` leaves."""
        return cls(0, np.zeros(leaves), np.zeros(leaves), np.zeros(leaves + 1), 0.0, 0.0, 0.0)

    def with_more(self, other: Sums) -> Sums:
        """Returns the sums over the parts of this object and of another."""
        return Sums(*map(add, self, other))

    def document(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        return {name: np.asarray(value).tolist() for name, value in self._asdict().items()}

    @classmethod
    def of_document(cls, document: dict[str, Any], leaves: int) -> Self:
        """Converts the output of the method `document` back to sums.

        Raises:
            KeyError, TypeError, ValueError: the document is invalid, has another number of leaves, or counts
                more outcomes than parts.
        """
        empty = cls.none(leaves)._asdict()
        sums: dict[str, Any] = {name: np.array(document[name], np.float64)[()] for name in empty}
        if any(np.shape(sums[name]) != np.shape(value) for name, value in empty.items()):
            raise ValueError("sums of another table")
        result = cls(**{**sums, "parts": int(sums["parts"])})
        ended = result.visits.sum() + result.rejected + result.crashed
        counted = np.array([*result.visits, *(result.visits - result.wrong), *result.squares])
        if not (counted.min() >= 0.0 and 0.0 <= ended <= result.parts):  # not if nan
            raise ValueError("more outcomes than parts")
        return result


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """A simulation of many parts in chunks, each of which can run in another process.

    Calling the study with a chunk's number runs that chunk.
    """

    program: Program  # the table
    job: Job  # the true parts and gripper
    worlds: Worlds  # worlds that squeeze the parts, one for each chunk
    seed: int  # seed of all random draws
    # (N,) total number of copies of a part at each node, with those made at earlier nodes; powers of two.
    copies: IntArray
    disturbance: Disturbance  # errors of the cell

    def identity(self, world: str) -> str:
        """Digest of everything on which the sums of a study depend.

        Args:
            world: the world and its changes, in words.
        """
        parts = [self.program.table, self.job.digest(), world, self.seed, CHUNK]
        parts += [self.copies.tolist(), self.disturbance]
        return hashlib.sha256(repr(parts).encode()).hexdigest()

    def __call__(self, chunk: int) -> Sums:
        """Runs a chunk of `CHUNK` parts, given its number, and returns its sums."""
        rng = np.random.default_rng([self.seed, chunk, SEED_PPM])
        cell = Cell(self.program, self.job, self.worlds.world(chunk), self.disturbance, rng)
        run, part, weight = cell.split(CHUNK, self.copies)
        leaves, ended, wrong = len(self.program.table.leaves), run.leaf >= 0, run.wrong
        return Sums(
            parts=CHUNK,
            visits=_sum(run.leaf[ended], weight[ended], leaves),
            wrong=_sum(run.leaf[wrong], weight[wrong], leaves),
            squares=_squares(part[wrong], run.leaf[wrong], weight[wrong], leaves),
            rejected=float(weight[run.rejected].sum()),
            crashed=float(weight[run.leaf == CRASHED].sum()),
            squeezes=float(weight @ run.squeezes),
        )


def _sum(group: IntArray, weight: Array, groups: int) -> Array:
    """(groups,) sum of the weights in each group."""
    # `bincount` returns integers where there is no weight.
    return np.asarray(np.bincount(group, weight, groups), np.float64)


def _squares(part: IntArray, leaf: IntArray, weight: Array, leaves: int) -> Array:
    """Sums of squared weights (leaves + 1,): one for each leaf, then one for all leaves together.

    Each part contributes a square to the sum of a leaf: the weights of its copies in this leaf are added up,
    and the total is squared. For the last sum, the weights of its copies in any leaf are added up first.
    """
    key, inverse = np.unique(part * leaves + leaf, return_inverse=True)
    once = _sum(inverse, weight, len(key))
    whole = _sum(part, weight, 0)
    return np.append(_sum(key % leaves, once**2, leaves), (whole**2).sum())


def copies_of(table: Table) -> IntArray:
    """How many copies of a part are simulated from each node on; more where few parts are predicted to be.

    Args:
        table: a table of N nodes, children after their parents.

    Returns:
        (N,) powers of two, 1 at the root, never fewer than at the parent.
    """
    share, copies = np.ones(len(table.nodes)), np.ones(len(table.nodes), np.int64)
    for index, node in enumerate(table.nodes):
        for branch in node.branches:
            if branch.target >= 0:
                share[branch.target] = share[index] * (branch.probability_ppm + 1) / PPM
                wanted = min(SPLIT_BELOW / share[branch.target], MOST_COPIES)
                copies[branch.target] = max(copies[index], 1 << max(0, int(math.log2(wanted))))
    return copies


class Bound(NamedTuple):
    """A rate with its lower and upper bound [ppm]; both bounds hold with probability 1 - `ERROR`."""

    low: float
    rate: float
    high: float

    @classmethod
    def of(cls, total: float, parts: int) -> Self:
        """Bounds the mean of independent weights in [0, 1], one weight for each part.

        The bounds are a confidence sequence: they hold for all numbers of parts at once. Let S be the sum of
        n weights and m their true mean. For any constant p in (0, 1), (p / m)^S ((1 - p) / (1 - m))^(n - S)
        has expectation at most 1. So has its mixture over p with the beta distribution `PRIOR`. Therefore the
        mixture ever exceeds 1 / ERROR with probability ERROR at most (Ville 1939; Howard et al. 2021, section
        3.2, beta-binomial mixture). The bounds enclose all m for which the mixture does not exceed 1 / ERROR.

        Args:
            total: sum S of the weights.
            parts: number n of parts, at least 1.
        """
        from scipy.optimize import brentq  # importing it takes a quarter of the start-up time

        a, b = PRIOR
        mixture = betaln(a + total, b + parts - total) - betaln(a, b) + math.log(ERROR)

        def excess(mean: float) -> float:
            return float(mixture - xlogy(total, mean) - xlog1py(parts - total, -mean))

        rate = total / parts
        least, most = 1e-9 * rate, 1.0 - 1e-9  # means that few parts may not exclude
        low = brentq(excess, least, rate, xtol=1e-15) if excess(least) > 0.0 else 0.0
        high = brentq(excess, rate, most, xtol=1e-15) if excess(most) > 0.0 else 1.0
        return cls(PPM * low, PPM * rate, PPM * high)


def continued(study: Study, sums: Sums, parts: int, scheduler: Scheduler) -> Iterator[Sums]:
    """Runs the chunks of a study that `sums` lacks, until at least `parts` parts are done.

    Args:
        study: the study.
        sums: sums of the whole chunks that were run earlier.
        parts: total number of parts at the end; rounded up to whole chunks.
        scheduler: runs the chunks; the sums do not depend on it.

    Yields:
        The sums after every chunk.
    """
    chunks = range(sums.parts // CHUNK, -(-parts // CHUNK))
    for more in scheduler.map(study, chunks):
        sums = sums.with_more(more)
        yield sums


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """Results of a study; rates and bounds in parts per million of all parts."""

    sums: Sums  # the sums behind the results
    wrong: Bound  # rate of confident wrong answers
    leaves: list[Bound]  # rate of confident wrong answers of each leaf

    @classmethod
    def of(cls, sums: Sums) -> Self:
        """Computes the results from sums over at least one part."""
        wrong = Bound.of(float(sums.wrong.sum()), sums.parts)
        return cls(sums, wrong, [Bound.of(float(total), sums.parts) for total in sums.wrong])

    def standard_error(self, leaf: int | None = None) -> float:
        """Standard error of the rate of wrong answers of a leaf; of all leaves together if None [ppm]."""
        parts, index = self.sums.parts, -1 if leaf is None else leaf
        rate = (self.wrong if leaf is None else self.leaves[leaf]).rate / PPM
        variance = float(self.sums.squares[index]) / parts - rate * rate
        return PPM * math.sqrt(max(variance, 0.0) / parts)

    def worst(self, most: int) -> list[int]:
        """Indices of at most `most` leaves with wrong answers, the highest rate first."""
        order = sorted(range(len(self.leaves)), key=lambda leaf: (-self.leaves[leaf].rate, leaf))
        return [leaf for leaf in order[:most] if self.leaves[leaf].rate > 0.0]

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        sums = self.sums
        return {
            "parts": sums.parts,
            "confidence": 1.0 - ERROR,
            "wrong_ppm": self.wrong._asdict(),
            "standard_error_ppm": self.standard_error(),
            "rejected_ppm": PPM * sums.rejected / sums.parts,
            "crashed_ppm": PPM * sums.crashed / sums.parts,
            "mean_squeezes": sums.squeezes / sums.parts,
            "leaves": [
                {
                    "leaf": leaf,
                    "share_ppm": PPM * float(sums.visits[leaf]) / sums.parts,
                    "wrong_ppm": bound._asdict(),
                    "standard_error_ppm": self.standard_error(leaf),
                }
                for leaf, bound in enumerate(self.leaves)
            ],
        }

    def lines(self) -> list[str]:
        """Returns the findings as lines of text."""
        sums, wrong, parts = self.sums, self.wrong, self.sums.parts
        bounds = f"at least {wrong.low:.2f} and at most {wrong.high:.2f} with {1.0 - ERROR:.0%} confidence"
        entries = [
            f"wrong      {wrong.rate:.2f} ppm, {bounds}, at every look",
            f"rejected   {PPM * sums.rejected / parts:.0f} ppm",
            f"crashes    {PPM * sums.crashed / parts:.0f} ppm",
            f"squeezes   {sums.squeezes / parts:.3f}  a part",
        ]
        head = "leaves     "
        for leaf in self.worst(MOST_ROWS):
            bound, share = self.leaves[leaf], sums.wrong[leaf] / sums.visits[leaf]
            entries.append(
                f"{head}leaf {leaf}: {bound.rate:.2f} ppm, at most "
                f"{bound.high:.2f} (standard error {self.standard_error(leaf):.2f}); {share:.3%} of the "
                f"{PPM * sums.visits[leaf] / parts:.0f} ppm that end there"
            )
            head = " " * len(head)
        return entries


def resumed(path: Path, identity: str, leaves: int) -> Sums:
    """Reads the sums of a study from a file; returns empty sums if there is no file.

    Args:
        path: the file.
        identity: `Study.identity` of the study.
        leaves: number of leaves of the study's table.

    Raises:
        InputError: the file cannot be read, or holds another study.
    """
    if not path.exists():
        return Sums.none(leaves)
    try:
        document = strict_json.parse(path.read_bytes())
        if document["study"] == identity:
            return Sums.of_document(document["sums"], leaves)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", where=str(path)) from error
    except (ValueError, KeyError, TypeError, OverflowError):
        pass
    problem = "is no study of this table in this world with this seed; name another file"
    raise InputError(problem, where=str(path))


def keep(path: Path, identity: str, sums: Sums) -> None:
    """Saves the sums of a study under its identity, for `resumed` to continue from.

    Raises:
        OutputError: the file cannot be written.
    """
    with writing(path) as draft:
        draft.write_text(json.dumps({"study": identity, "sums": sums.document()}))
