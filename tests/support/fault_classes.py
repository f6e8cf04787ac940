"""How a part may end after each class of faults, as drivers/sim/FAULTS.md says."""

import re

from programs import ROOT

from runtime.traversal.results import PartResult

TABLE = (ROOT / "drivers" / "sim" / "FAULTS.md").read_text()
ROWS = {
    name: [cell.strip() for cell in rest.split("|")]
    for name, rest in re.findall(r"^\| `(\w+)` \|(.+)\|$", TABLE, re.MULTILINE)
}
DECIDED = {"leaf", "unresolved", "reject"}


def allowed(outcomes: str, result: PartResult, sound: PartResult) -> bool:
    """Whether a part may end so."""
    for outcome in outcomes.split(", "):
        if outcome == "same" and (result.outcome, result.leaf) == (sound.outcome, sound.leaf):
            return True
        if outcome == "decided" and result.outcome.value in DECIDED:
            return True
        if f"{result.outcome.value} {result.exit_code}" in (
            outcome,
            f"{outcome} {result.exit_code}",
        ):
            return True
    return False
