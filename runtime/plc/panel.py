"""The values that an OPC UA server shows, by path, derived from the states of a station.

A path consists of the browse names below the object `VisionSystem`. The module does not use OPC UA's library.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from runtime.plc import vision
from runtime.plc.handshake import SIGNALS
from runtime.plc.registers import OUTCOMES
from runtime.plc.station import Answer, Glance

MACHINE = "VisionStateMachine"
AUTOMATIC = f"{MACHINE}/AutomaticModeStateMachine"
RECIPES = "RecipeManagement"
CONFIGURATION = "ConfigurationManagement"
RESULTS = "ResultManagement"
PACKML = "PackML"
MOST_RESULTS = 1000  # results kept for `GetResultById`

Value = str | int | float | bool


class Offer(NamedTuple):
    """A recipe: a table that a client may prepare."""

    id: str
    digest: str  # SHA-256 of the table's file
    parts: list[str]  # names of its parts, empty for a single part


class Configuration(NamedTuple):
    """The current calibration of the gripper."""

    id: str
    digest: str  # SHA-256 of its file, "" for the linear map


class Change(NamedTuple):
    """A transition between two displayed states of the vision system."""

    left: vision.VisionState
    entered: vision.VisionState

    @property
    def name(self) -> str:
        """Name of the transition in the specification."""
        return f"{self.left.value}To{self.entered.value}"


class Panel:
    """Values for OPC UA clients: a station's state, the latest results, and counts since the process started.

    Attributes:
        offers: the recipes, by the numbers of their tables.
        configuration: the current configuration.
        results: the latest results, by their ids.
        job: the job of the current part or of the waiting result; if there is neither, the last job.
        seen: the latest state of the station.
    """

    def __init__(
        self, offers: Sequence[Offer], configuration: Configuration, first: Glance
    ) -> None:
        self.offers = offers
        self.results: dict[str, vision.Result] = {}
        self.job = vision.Job(0, "", "", "", "", "")
        self.configuration = configuration
        self.seen = first
        self._last = vision.NO_RESULT
        self._counts = dict.fromkeys(OUTCOMES[1:], 0)
        self._reason = 0

    @property
    def state(self) -> vision.VisionState:
        """The state of the vision system (OPC 40100-1) that clients see."""
        return vision.view(self.seen).state

    def see(self, seen: Glance) -> Change | None:
        """Takes in a new state of the station; returns the change of the displayed state, if any."""
        before, self.seen = self.seen, seen
        if vision.waits(seen) and not vision.waits(before):
            self._finish(seen.answer, self.offers[seen.in_use].parts)
        reason = vision.stop_reason(before, seen)
        if reason is not None:
            self._reason = reason
        change = Change(vision.view(before).state, vision.view(seen).state)
        return change if change.left is not change.entered else None

    def _finish(self, answer: Answer, parts: list[str]) -> None:
        self._last = vision.result_of(self.job, parts, answer)
        self._counts[self._last.Outcome] += 1
        self.results[self._last.ResultId] = self._last
        if len(self.results) > MOST_RESULTS:
            del self.results[next(iter(self.results))]

    def values(self) -> Iterator[tuple[str, Value]]:
        """Yields all values, each with its path."""
        seen, row = self.seen, vision.view(self.seen)
        prepared = None if seen.table is None else self.offers[seen.table]
        yield f"{MACHINE}/CurrentState", row.state.outer
        yield f"{AUTOMATIC}/CurrentState", row.state.value if row.state.automatic else ""
        yield f"{MACHINE}/AutomaticSelected", seen.enabled
        yield f"{MACHINE}/ErrorId", int(seen.error_id)
        yield f"{MACHINE}/JobId", self.job.id
        yield f"{MACHINE}/MeasId", self.job.meas_id
        yield f"{MACHINE}/Busy", SIGNALS[seen.state].busy
        yield f"{RECIPES}/PreparedRecipe", prepared.id if prepared else ""
        yield f"{RECIPES}/PreparedDigest", prepared.digest if prepared else ""
        for offer in self.offers:
            yield f"{RECIPES}/Recipes/{offer.id}/Digest", offer.digest
        yield f"{CONFIGURATION}/ActiveConfiguration", self.configuration.id
        yield f"{CONFIGURATION}/Digest", self.configuration.digest
        yield f"{RESULTS}/ResultReady", vision.waits(seen)
        for name, value in self._last._asdict().items():
            yield f"{RESULTS}/LastResult/{name}", value
        yield f"{PACKML}/StateCurrent", row.packml.value
        yield f"{PACKML}/StateCurrentName", row.packml.name.capitalize()
        for outcome, count in self._counts.items():
            yield f"{PACKML}/{outcome.capitalize()}", count
        yield f"{PACKML}/StopReasonId", self._reason
        yield f"{PACKML}/StopReason", vision.STOP_REASONS.get(self._reason, f"error {self._reason}")
