"""The operator's screen: its words for a run, names shown as text, and how a run ended."""

from dataclasses import replace

import pytest
from browser import LEGIBLE, NEEDED, played
from fake_cell import Deaf
from html_pages import Page
from sample_tables import small_table
from statuses import status_of

from runtime.execution.events import Phase, Tally
from runtime.monitoring.live import operator, page
from runtime.monitoring.monitor import Monitor, Views, ended
from runtime.pages import frame
from runtime.table import dump, load
from runtime.traversal.results import Outcome, PartResult, Step

TABLE = small_table()
OUTLINE = [[0.0, 0.0], [30.0, 0.0], [30.0, 21.0]]
STEP = Step(1, 0, TABLE.nodes[0].squeeze, 174, 21_000, ~0, None)
EVIL = '<img src=x onerror="alert(1)">Prüfling\'s "Ä" & more'


def status():
    return status_of(TABLE, EVIL, 6.0)


def shown(status):
    seen = status.as_object()
    text = f"<main>{operator.state(seen)}{operator.screen(TABLE, [OUTLINE], seen)}</main>"
    assert not Page(text).open
    return text


def part(number=1, outcome=Outcome.LEAF, steps=(STEP,), reason=None, **fields):
    return replace(PartResult.of(number, outcome, list(steps), reason), seconds=5.0, **fields)


@pytest.mark.parametrize("phase", Phase)
def test_operator_screen_has_words_for_every_phase(phase):
    seen = status()
    seen.phase(3, phase, None)
    assert operator.PHASES[phase.value] in shown(seen)


@pytest.mark.parametrize("outcome", [outcome for outcome in Outcome if outcome is not Outcome.LEAF])
def test_operator_screen_lost_part_is_named_and_drawn(outcome):
    seen = status()
    seen.part(part())
    for steps in ([], [STEP]):
        seen.part(part(2, outcome, steps, EVIL))
    text = shown(seen)
    assert operator.KINDS[outcome.value] in text
    assert text.count("<figure>") == text.count('class="scene"') == 2
    assert text.count('class="part"') == 2
    assert "1 of 3 parts" in text


def test_operator_screen_names_and_reasons_are_escaped():
    seen = status()
    seen.part(part(1, Outcome.REJECT, [STEP], EVIL))
    text = shown(seen)
    assert "<img" not in text
    assert "&lt;img src=x onerror=&quot;alert(1)&quot;&gt;Prüfling" in text


def test_ended_part_given_up_is_poor_but_no_fault():
    """A robot that closes its connection ends the run, as a failed device would; the cell has no fault."""
    tally = Tally()
    tally.add(part(1, Outcome.ABORTED, [], "the robot hung up"), None)
    assert ended(tally) == ("poor", "A part was given up. 1 part, 0 located.")


def test_ended_normal_run_is_good_and_fault_states_cause():
    tally = Tally()
    tally.add(part(), None)
    assert ended(tally) == ("good", "Ended as planned. 1 part, 1 located.")
    said = "no answer from the gripper"
    failed = part(2, Outcome.FAULT, [], said, safe_state=("fingers stopped",))
    tally.add(failed, None)
    seen = status()
    seen.part(failed)
    seen.end(*ended(tally))
    text = shown(seen)
    assert "No answer from the gripper; fingers stopped" in text
    assert "verdict poor" in text
    assert "data-ended" in text


BROKEN = [(KeyboardInterrupt(), "Stopped by the operator")]
BROKEN += [(OSError("disk <full>"), "Ended by an error: disk &lt;full&gt;")]


@pytest.mark.parametrize(("error", "sentence"), BROKEN)
def test_monitor_of_broken_off_run_shows_reason(tmp_path, error, sentence):
    dump(TABLE, tmp_path / "t")
    monitor = Monitor(Deaf(), load(tmp_path / "t"), tmp_path / "t", Views())
    with pytest.raises(type(error)), monitor:
        raise error
    assert sentence in operator.state(monitor._status.as_object())


@NEEDED
@pytest.mark.slow
def test_operator_screen_is_legible_and_fits_telephone(tmp_path):
    seen = status()
    for number in range(1, 60):
        seen.part(part(number, steps=[STEP._replace(width_um=21_900)]))
        seen.part(part(number, Outcome.REJECT, [STEP], EVIL))
    style = (page.TEMPLATES / "live.css").read_text("utf-8")
    whole = frame.page(EVIL, shown(seen), style=style)
    assert played(whole, LEGIBLE, tmp_path, 390) == {"small": [], "over": 0}
