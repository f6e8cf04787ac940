"""Starts after a stop or a crash that left a part in the fingers, and starts that fail."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from programs import ROOT, RUNTIME, WAIT_S, Ended, called, started
from written_journals import assert_sound

from drivers.sim.cell import Cell
from drivers.sim.physics.scene import REHEARSAL, load
from runtime.cli import main
from runtime.journal.chain import records

TIME_SCALE = 20.0
RETREAT_MM, SQUEEZE_MM = 60.0, 10.0


class Station:
    """A simulated cell in this process. Runs that get a signal are separate processes."""

    def __init__(self, tree: Path) -> None:
        self.tree, self.journal = tree, tree.with_name("journal.jsonl")
        self.cell = Cell(load(self.tree, None, REHEARSAL), 0, TIME_SCALE)
        self.gripper, self.table = self.cell.works.gripper, self.cell.works.table

    def words(self, *words: str) -> list[str]:
        ports = self.cell.endpoints
        given = ["--tree", str(self.tree), "--tips", "straight", "--force", "direct"]
        given += ["--port", ports["gripper"], "--arm", ports["arm"]]
        return [*given, "--journal", str(self.journal), *words]

    def run(self, *words: str) -> Ended:
        return called(main, *self.words(*words))

    def strike(self, number: signal.Signals, when: Callable[[], bool], *words: str) -> Ended:
        """Starts a run and sends it a signal as soon as `when` returns true; returns how the run ended."""
        process = started([*RUNTIME, *self.words(*words)])
        deadline = time.monotonic() + WAIT_S

        def struck() -> bool:
            if strikes := when():
                process.send_signal(number)
            return strikes

        while process.poll() is None and time.monotonic() < deadline:
            if self.cell.call(struck):
                break
            time.sleep(0.001)
        out, err = process.communicate(timeout=WAIT_S)
        return Ended(process.returncode, out, err)

    def grips(self) -> bool:
        return self.gripper._gripping

    def kinds(self) -> list[object]:
        return [entry["kind"] for entry in records(self.journal)] if self.journal.exists() else []

    def stands(self) -> tuple[float, float, float, float]:
        """The position of the arm and the opening of the jaws [mm]."""

        def look() -> tuple[float, float, float, float]:
            now_s = self.cell.works.now()
            x_mm, y_mm, z_mm, _ = self.cell.works.arm.pose_at(now_s)
            return x_mm, y_mm, z_mm, self.gripper.opening_mm(now_s)

        return self.cell.call(look)


@pytest.fixture
def station(tree: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Station]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tree.parent))
    result = Station(tree)
    with result.cell:
        yield result


def is_refused(station: Station, code: int, *words: str) -> str:
    """Checks that a start is refused without motion or record; returns the line of the error."""
    before, kinds = station.stands(), station.kinds()
    ended, _, err = station.run(*words)
    assert (ended, err.count("\n")) == (code, 1), err
    assert (station.stands(), station.kinds()) == (before, kinds)
    return err


def test_grasp_runtime_part_held_after_stop_is_refused_until_put_down(station) -> None:
    code, out, err = station.strike(signal.SIGINT, station.grips, "--activate", "--count", "9")
    assert code == 40, (out, err)
    assert station.grips()
    assert station.stands()[2] == pytest.approx(RETREAT_MM, abs=0.1)
    said = is_refused(station, 20, "--activate", "--after-crash", "resume")
    assert "hold something" in said
    assert "--put-down" in said
    assert "ended as stopped" in said
    code, out, err = station.run("--put-down")
    assert code == 0, (out, err)
    assert "put down at" in out
    assert (station.grips(), station.table.drops) == (False, 0)
    assert station.stands()[2] == pytest.approx(RETREAT_MM, abs=0.1)
    assert station.kinds()[-4:] == ["header", "put_down", "put_down", "end"]
    assert station.run()[0] in (0, 10)
    assert station.table.drops == 0
    assert_sound(station.journal)


def test_grasp_runtime_part_held_after_aborted_run_is_not_dropped(station):
    station.strike(signal.SIGKILL, station.grips, "--activate")
    code, _, err = station.run()
    assert code == 24
    assert "given up and nothing was moved" in err
    said = is_refused(station, 20)
    assert "ended as aborted" in said
    assert "they met it while closing" in said
    assert station.stands()[2] == pytest.approx(SQUEEZE_MM, abs=0.1)
    assert station.run("--put-down")[0] == 0
    assert (station.grips(), station.table.drops) == (False, 0)
    assert_sound(station.journal)


def test_grasp_runtime_gripper_reset_with_part_is_not_activated(station) -> None:
    station.strike(signal.SIGINT, station.grips, "--activate")
    station.cell.call(lambda: station.gripper.power_cycle(station.cell.works.now()))
    said = is_refused(station, 20, "--activate")
    assert "cannot tell" in said
    assert "--jaws-empty" in said
    code, out, err = station.run("--activate", "--jaws-empty")
    assert code in (0, 10), (out, err)


def test_resume_within_exceeded_is_refused_without_motion(station) -> None:
    station.strike(signal.SIGKILL, station.grips, "--activate")
    time.sleep(0.05)
    said = is_refused(station, 24, "--after-crash", "resume", "--resume-within", "0.01")
    assert "--resume-within" in said


HELLO = "input(); print('hello', flush=True); input()"
BAD_AUDITORS = ["/no/such/auditor", str(ROOT / "README.md"), f"{sys.executable} -c pass"]
BAD_AUDITORS.append(f'{sys.executable} -c "{HELLO}"')


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ((), 20),  # the gripper is not activated
        (("--activate", "--tips", "10,5"), 3),  # the table leaves no room for these tips
        *((("--activate", "--audit", auditor), 2) for auditor in BAD_AUDITORS),
    ],
)
def test_grasp_runtime_failing_start_moves_and_writes_nothing(station, words, code) -> None:
    before = station.stands()
    ended, _, err = station.run(*words)
    assert (ended, err.splitlines()[-1].startswith("grasp-runtime: ")) == (code, True), err
    assert not station.journal.exists()
    assert bytes(station.gripper.read_output()) == bytes(16)
    assert station.stands() == before
