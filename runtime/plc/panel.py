"""The values that an OPC UA server shows to clients, derived from the states of a PLC's station.

Each value has a path: the browse names below the object `VisionSystem`. The module does not import asyncua.
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
    """A recipe: a table that a client may select for the next part."""

    id: str  # name under which clients select the recipe
    digest: str  # SHA-256 of the table's file
    parts: list[str]  # names of the table's parts; empty for a single part


class Configuration(NamedTuple):
    """The calibration of the gripper that the run uses."""

    id: str  # name of the calibration
    digest: str  # SHA-256 of the calibration's file; "" if nominal widths are used


class Change(NamedTuple):
    """A change of the state that clients see: the state that is left, and the state that is entered."""

    left: vision.VisionState
    entered: vision.VisionState

    @property
    def name(self) -> str:
        """Name of the transition in the form of OPC 40100-1, such as ReadyToSingleExecution."""
        return f"{self.left.value}To{self.entered.value}"


class Panel:
    """Values for OPC UA clients: the station's state, the latest results, and numbers of parts by outcome.

    The parts are counted since this process began.

    Attributes:
        offers: the recipes; the index of each is the number of its table.
        configuration: the gripper's calibration.
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
        """The state that clients see now, one of OPC 40100-1."""
        return vision.view(self.seen).state

    def see(self, seen: Glance) -> Change | None:
        """Updates the values for a new state of the station.

        Returns:
            The change of the state that clients see; None if this state stays.
        """
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
        """Yields all values that clients see, as pairs of a path and a value."""
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
