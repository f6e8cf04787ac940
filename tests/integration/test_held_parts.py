"""Starts upon what a stop or a crash left behind, and starts that fail: nothing falls, nothing is made up."""

import contextlib
import math
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from programs import ROOT, RUNTIME, WAIT_S, Ended, called, started
from written_journals import assert_sound

from drivers import connect
from drivers.sim.cell import Cell
from drivers.sim.physics.scene import REHEARSAL, load
from drivers.sim.wire.line import CleanLine
from runtime.cli import main
from runtime.journal.chain import records

TIME_SCALE = 20.0
RETREAT_MM, SQUEEZE_MM = 60.0, 10.0
FORCE_AT = 5  # of rFR in the output block


class Station:
    """A cell in this process, with a rehearsal behind it; runs that are struck are processes of their own."""

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
        """Start, and send a signal while the gripper waits to answer in the state asked for."""
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
        """Where the arm is, and the opening."""

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
    """The one line of a start that moves nothing and records nothing."""
    before, kinds = station.stands(), station.kinds()
    ended, _, err = station.run(*words)
    assert (ended, err.count("\n")) == (code, 1), err
    assert (station.stands(), station.kinds()) == (before, kinds)
    return err


def test_a_part_that_a_stop_left_in_the_air_is_put_down_only_if_asked(station) -> None:
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


def test_a_run_given_up_with_a_part_in_the_fingers_is_not_followed_by_one_that_drops_it(
    station,
) -> None:
    station.strike(signal.SIGKILL, station.grips, "--activate")
    code, _, err = station.run()
    assert code == 24
    assert "nothing was moved" in err
    said = is_refused(station, 20)
    assert "ended as aborted" in said
    assert "they met it while closing" in said
    assert station.stands()[2] == pytest.approx(SQUEEZE_MM, abs=0.1)
    assert station.run("--put-down")[0] == 0
    assert (station.grips(), station.table.drops) == (False, 0)
    assert_sound(station.journal)


def test_a_gripper_that_lost_its_power_with_a_part_in_it_is_not_activated(station) -> None:
    station.strike(signal.SIGINT, station.grips, "--activate")
    station.cell.call(lambda: station.gripper.power_cycle(station.cell.works.now()))
    said = is_refused(station, 20, "--activate")
    assert "cannot tell" in said
    assert "--jaws-empty" in said
    code, out, err = station.run("--activate", "--jaws-empty")
    assert code in (0, 10), (out, err)


def test_jaws_stopped_on_their_way_may_hold_something(station) -> None:
    def on_their_way() -> bool:
        gripper = station.gripper
        closes = gripper._ends_s < math.inf and gripper._stroke.rate > 0
        return closes and "placed" in station.kinds()

    assert station.strike(signal.SIGINT, on_their_way, "--activate")[0] == 40
    if station.grips():
        pytest.skip("the stop came when the part was met")
    assert "may hold something: they were stopped on their way" in is_refused(station, 20)


def open_fully(station: Station) -> None:
    with contextlib.closing(connect.gripper(station.cell.endpoints["gripper"])) as gripper:
        gripper.move(85_000, 150.0, 20.0)
        gripper.wait()


@pytest.mark.parametrize("height_mm", [SQUEEZE_MM, RETREAT_MM])
def test_a_part_let_go_and_a_hand_moved_since_are_not_gone_on_with(station, height_mm) -> None:
    station.strike(signal.SIGKILL, lambda: "squeeze" in station.kinds(), "--activate")
    open_fully(station)
    with contextlib.closing(connect.arm(station.cell.endpoints["arm"])) as arm:
        arm.move_linear(30.0, 20.0, RETREAT_MM, 0.0, 250.0)
        arm.move_linear(30.0, 20.0, height_mm, 0.0, 250.0)
    before = station.stands()
    code, out, _ = station.run("--after-crash", "resume")
    assert code == 24
    assert "not where the run broke off" in out
    assert station.stands() == before
    assert_sound(station.journal)


def test_a_part_of_long_ago_is_not_gone_on_with(station) -> None:
    station.strike(signal.SIGKILL, station.grips, "--activate")
    time.sleep(0.05)
    said = is_refused(station, 24, "--after-crash", "resume", "--resume-within", "0.01")
    assert "--resume-within" in said


class LosesForces:
    """Loses the first write of each block that raises the force and nothing else."""

    def __init__(self, station: Station) -> None:
        self._station, self._before, self._lost = station, b"", set[bytes]()
        self.lost, self.forces = 0, list[int]()

    def hears(self, frame: bytes) -> bool:
        if frame[1] != 16:
            return True
        block, before, self._before = frame[7:13], self._before, frame[7:13]
        # What it gripped with, as the jaws are told to open.
        if block[3] != 255 and before[3:4] == b"\xff":
            self.forces.append(self._station.gripper.read_output()[FORCE_AT])
        if block[:5] != before[:5] or block == before:
            return True
        self.lost += 1
        return False


def test_a_force_that_was_lost_on_the_way_is_written_again(
    station, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = LosesForces(station)
    monkeypatch.setattr(CleanLine, "hears", lambda _, frame: line.hears(frame))
    # What is carried is held with the table's force, what is only squeezed with the least one.
    code, out, err = station.run("--activate", "--force", "regulated", "--deliver", "20,-10,0")
    assert code in (0, 10), (out, err)
    assert line.lost
    assert set(line.forces) == {0, (40_000 - 20_000) * 255 // (235_000 - 20_000)}
    assert "write unanswered" in [entry.get("incident") for entry in records(station.journal)]
    assert_sound(station.journal)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ((), 20),  # it is not activated
        (("--activate", "--tips", "10,5"), 3),  # the table leaves no room for these
        *(
            (("--activate", "--audit", auditor), 2)
            for auditor in (
                "/no/such/auditor",
                str(ROOT / "README.md"),
                f"{sys.executable} -c pass",
                f"{sys.executable} -c \"input(); print('hello', flush=True); input()\"",
            )
        ),
    ],
)
def test_a_start_that_fails_moves_and_writes_nothing(station, words, code) -> None:
    before = station.stands()
    ended, _, err = station.run(*words)
    assert (ended, err.splitlines()[-1].startswith("grasp-runtime: ")) == (code, True), err
    assert not station.journal.exists()
    assert bytes(station.gripper.read_output()) == bytes(16)
    assert station.stands() == before
