"""Evaluation of a table in a world over many simulated trials (paper VII).

The trials run the table as the runtime does; they use nothing of the planner's belief.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from planner.evaluation.cases import Case
from planner.evaluation.disturbance import NONE, Disturbance
from planner.evaluation.outcome import Evaluation
from planner.evaluation.trials import Cell, Program
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler, Threads
from planner.world import ContactWorlds, World, Worlds
from runtime.table import Table

CHUNK = 1000
SEED_TRIALS = 0x4556414C


class Chunk(NamedTuple):
    """Trials that share one random stream; the unit of work of a scheduler."""

    number: int
    trials: int


def chunks_of(trials: int) -> list[Chunk]:
    """Cuts a number of trials into chunks of 1000 and a remainder."""
    starts = range(0, trials, CHUNK)
    return [Chunk(number, min(CHUNK, trials - start)) for number, start in enumerate(starts)]


def run_chunk(
    program: Program, job: Job, world: World | Worlds, seed: int, cell: Disturbance, chunk: Chunk
) -> Evaluation:
    """Runs the trials of one chunk and returns their outcomes; a scheduler may call it in another process.

    If `world` is a supply (`Worlds`), the chunk gets the world with the chunk's number.
    """
    rng = np.random.default_rng([seed, chunk.number, SEED_TRIALS])
    part_world = world.world(chunk.number) if isinstance(world, Worlds) else world
    return Cell(program, job, part_world, cell, rng).run(chunk.trials)


def evaluate(
    table: Table,
    job: Job,
    world: World | Worlds,
    trials: int,
    seed: int,
    scheduler: Scheduler | None = None,
    disturbance: Disturbance = NONE,
    report: Report = silent,
) -> Evaluation:
    """Runs a table on simulated parts, in chunks of 1000, and returns the outcome of each part.

    Args:
        table: the table.
        job: states the true parts and gripper; may differ from the job that the table was compiled from.
        world: one world, in which chunks run one after another, or a supply of worlds, one for each chunk, so
            that workers share the chunks.
        trials: number of parts, at least 1.
        seed: determines initial poses, latent parameters, encoder noise and the arm's errors; the world has a
            seed of its own.
        scheduler: runs the chunks; threads on all cores if None. The result does not depend on it.
        disturbance: errors of the cell.
        report: receives the progress.
    """
    chunks = chunks_of(trials)
    run_all = (scheduler or Threads()).map if isinstance(world, Worlds) else map
    results = run_all(partial(run_chunk, Program.of(table), job, world, seed, disturbance), chunks)
    done: list[Evaluation] = []
    for part in results:
        done.append(part)
        report("evaluate", len(done), len(chunks))
    return Evaluation.joined(done)


class Line(NamedTuple):
    """A case, and the evaluation of a table in it."""

    case: Case
    evaluation: Evaluation


def sweep(
    table: Table,
    job: Job,
    cases: Sequence[Case],
    trials: int,
    seed: int,
    scheduler: Scheduler | None = None,
    report: Report = silent,
    worlds: Callable[[Job], World | Worlds] | None = None,
) -> Iterator[Line]:
    """Evaluates a table in one case after another, with the same initial poses in all of them.

    Yields a line for each case. `worlds` builds the worlds for a case's job; if None, they are contact worlds
    with the seed `seed`. See `evaluate` for the other arguments.
    """
    for number, case in enumerate(cases):
        report("worlds", number, len(cases))
        real = case.job(job)
        world = worlds(real) if worlds else ContactWorlds.of_job(real, seed)
        yield Line(case, evaluate(table, real, world, trials, seed, scheduler, case.disturbance))


def worst_of(lines: Iterable[Line]) -> Line | None:
    """The case with the most wrong answers, and its evaluation; None if there are no lines."""
    return max(lines, key=lambda line: line.evaluation.wrong.sum(), default=None)
