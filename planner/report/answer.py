"""The answer of `squeezetree try` as lines for people."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from planner.evaluation.shares import in_percent, shares_of
from planner.report.verdict import Verdict, Weakest, error_text, listed

QUESTION = "Can it be located by squeezing?"


class Answer(NamedTuple):
    """Result of a first look at a part."""

    short: str  # a grade, or "cut" (search unfinished) or "unknown" (for most parts)
    verdict: Verdict  # verdict on the plan
    figures: dict[str, Any]  # figures of the plan, from `Evaluation.summary`
    most_squeezes: int
    worst: Weakest | None
    limits: list[str]  # what limits the plan, one sentence each
    # Assumptions made because the part is large, as clauses: "within 1 mm of ...".
    restrictions: list[str]
    confidence: float  # share of the parts that the goal requires

    def short_text(self) -> str:
        """The answer in one sentence, with its restrictions and conditions."""
        if self.short == "poor":
            return "Not well enough: see what limits it."
        if self.short == "unknown":
            remedy = "give it a longer --budget."
            return f"Not known yet: the search is not done for most parts; {remedy}"
        share = self.figures["success_rate"]
        located = f"for {in_percent(shares_of(self.figures).located)} of the parts"
        reservation = "" if share >= self.confidence else located
        if self.short == "cut":
            reservation = f"{located} so far; plan for longer to know the rest"
        conditions = listed(self.verdict.conditions)
        parts = ["Yes", " and ".join(self.restrictions), conditions, reservation]
        return ", ".join(filter(None, parts)) + "."

    def lines(self) -> list[str]:
        """The answer as lines: the sentence, warnings, shares, error, effort, weakest assumption, limits."""
        figures, shares = self.figures, shares_of(self.figures)
        low, high = figures["success_ci95"]
        others = {"wrong": shares.wrong, "given up": shares.unresolved, "rejected": shares.rejected}
        if figures["crashes"]:
            others["under a finger"] = shares.crashed
        rest = ", ".join(f"{word} {in_percent(share)}" for word, share in others.items())
        error = error_text(figures["error_mm"]).removeprefix("expected error ")
        squeezes = f"{figures['mean_squeezes']:.2f} squeezes a part, {self.most_squeezes} at most"
        return [
            f"{QUESTION} {self.short_text()}",
            *(f"Warning: {line}." for line in self.verdict.warnings),
            f"The plan {self.verdict.sentence}.",
            f"located    {in_percent(shares.located)} (95 % interval {low:.2%} to {high:.2%}), {rest}",
            f"error      {error}",
            f"effort     {squeezes}; {figures['seconds_mean']:.1f} s",
            f"weakest    {self.worst.text() if self.worst else 'not tried'}",
            *_block("limit", self.limits),
        ]


def _block(head: str, lines: Sequence[str]) -> list[str]:
    return [f"{head if not k else '':10s} {line}" for k, line in enumerate(lines)]
