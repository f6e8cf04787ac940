"""Warnings about jobs whose plan may work worse, or say less about the part, than its figures suggest."""

from collections.abc import Iterator

from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.part.outline import min_width

LOW_TIPS_MM = 2.0  # height of the finger tips above the table below which a job gets a warning
NEAR_TOP_MM = 1.5  # distance of the finger tips from the part's top below which a job gets one
LARGE_GOAL = 0.5  # goal, as a share of the part's least width, above which a job gets one
HARDLY = 0.01  # share of located trials below which a part, one of several, gets one


def warnings_of(job: Job) -> list[str]:
    """Returns warnings about finger tips near the table or near the part's top, and about goals too large.

    A goal is too large if it exceeds `LARGE_GOAL` times the part's least width. Each warning is a sentence
    without its full stop. It names the part if the job has several.
    """
    results = []
    for alone in job.alone:
        height_mm, tips_mm = alone.part.height_mm, job.cell.squeeze_height_mm
        name = f"{alone.part.name}: " if job.hypothesis else ""
        if tips_mm < LOW_TIPS_MM:
            low = f"the finger tips close {tips_mm:g} mm above the table"
            results.append(f"{name}{low}: an arm that is off by so much touches it")
        if height_mm is not None and height_mm - tips_mm < NEAR_TOP_MM:
            top = f"{height_mm - tips_mm:.3g} mm below the top of a part that is {height_mm:g} mm high"
            results.append(f"{name}the finger tips close {top}: they may slip over it")
        width_mm = min_width(alone.part.outline_mm)
        if job.goal.kind in ("pose", "modes") and job.goal.distance_mm > LARGE_GOAL * width_mm:
            says = f"located to {job.goal.distance_mm:g} mm says little of a part"
            less = f"ask for less than {LARGE_GOAL * width_mm:.2g} mm"
            results.append(f"{name}{says} that is {width_mm:.3g} mm wide; {less}")
    return list(dict.fromkeys(results))


def hardly_located(evaluation: Evaluation) -> Iterator[str]:
    """Yields a warning for each hypothesis whose parts hardly any trial locates."""
    for number, part in enumerate(evaluation.table.hypotheses):
        located = evaluation.success[evaluation.traits["hypothesis"] == number]
        if len(located) and (rate := located.mean()) < HARDLY:
            some = f"{part.name}: located in {rate:.2%} of its {len(located)} trials"
            yield f"{some}: add actions, ask for less, or leave it out"
