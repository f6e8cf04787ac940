"""`grasp-doctor` reports each fault in a sentence with its remedy."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from fake_cell import State, fake_cell
from programs import started
from sample_tables import GRIPPER, small_table

from runtime.commands import checks as doctor
from runtime.commands.checks import Finding, Verdict
from runtime.commands.doctor import parser, run
from runtime.shell.errors import CheckFailedError
from runtime.table import Calibration, dump

CALIBRATION = Calibration(GRIPPER.profile)


def verdicts(result) -> list[Verdict]:
    return [finding.verdict for finding in result]


def only(result) -> Finding:
    (finding,) = result
    return finding


def test_check_port_missing_names_existing_ports(tmp_path):
    folder = tmp_path / "dev"
    folder.mkdir()
    for name in ("ttyUSB3", "ttyACM0", "ttyS0"):
        (folder / name).touch()
    result = only(doctor.check_port(str(folder / "ttyUSB0"), tmp_path))
    assert result.verdict is Verdict.BAD
    assert "ttyACM0" in result.sentence
    assert "ttyUSB3" in result.sentence
    assert "ttyS0" not in result.sentence


def test_check_port_without_permission_names_group(monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    result = only(doctor.check_port("/dev/null"))
    assert "may not open" in result.sentence
    assert f"usermod -aG {Path('/dev/null').group()} $USER" in result.remedy
    monkeypatch.setattr(Path, "group", lambda path: (_ for _ in ()).throw(KeyError(7)))
    assert "dialout" in only(doctor.check_port("/dev/null")).remedy


def test_check_port_in_use_names_process(tmp_path):
    assert verdicts(doctor.check_port("/dev/null", tmp_path)) == [Verdict.GOOD] * 2
    folder = tmp_path / "proc"
    for pid, target in (
        ("4711", "/dev/null"),
        ("4712", "/dev/zero"),
        (str(os.getpid()), "/dev/null"),
    ):
        (folder / pid / "fd").mkdir(parents=True)
        (folder / pid / "fd" / "3").symlink_to(target)
        (folder / pid / "fd" / "4").symlink_to("/gone")
        (folder / pid / "comm").write_text("urcap_daemon\n")
    (folder / "4713").mkdir()
    good, bad = doctor.check_port("/dev/null", tmp_path)
    assert (good.verdict, bad.verdict) == (Verdict.GOOD, Verdict.BAD)
    assert "held by urcap_daemon (process 4711)." in bad.sentence


@pytest.mark.parametrize(
    ("value", "verdict", "message"),
    [("16\n", Verdict.WARNING, "16 ms"), ("1\n", Verdict.GOOD, "1 ms"), ("?", Verdict.GOOD, "no")],
)
def test_check_latency_warns_of_slow_timer(tmp_path, value, verdict, message):
    timer = tmp_path / "sys" / "bus" / "usb-serial" / "devices" / "ttyUSB0" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text(value)
    result = only(doctor.check_latency("/dev/ttyUSB0", tmp_path))
    assert (result.verdict, message in result.sentence) == (verdict, True)
    assert bool(result.remedy) == (verdict is not Verdict.GOOD)


@pytest.mark.parametrize(
    ("heard", "verdict", "message"),
    [
        ([], Verdict.BAD, "No slave id"),
        ([(4, 19200), (9, 115200)], Verdict.BAD, "as slave 4 at 19200 baud"),
        ([(9, 115200)], Verdict.WARNING, "answers now"),
    ],
)
def test_check_silence_reports_slaves_that_answer(heard, verdict, message):
    slaves = [SimpleNamespace(unit=unit, baud=baud) for unit, baud in heard]
    result = only(doctor.check_silence("p", lambda port: iter(slaves)))
    assert result.verdict is verdict
    assert message in result.sentence
    assert result.remedy


@pytest.mark.parametrize(
    ("state", "verdict"),
    [
        (State(), Verdict.GOOD),
        (State(activated=False), Verdict.WARNING),
        (State(fault=0x0E), Verdict.BAD),
    ],
    ids=["ready", "not activated", "fault"],
)
def test_check_gripper_judges_state_by_reading_only(state, verdict):
    rig = fake_cell([])
    rig.gripper.now = state
    assert only(doctor.check_gripper(rig.gripper)).verdict is verdict
    assert {call.name for call in rig.log.calls} == {"state"}


def test_check_table_misfit_is_reported():
    assert verdicts(doctor.check_table(small_table(), CALIBRATION)) == [Verdict.GOOD]
    narrow = Calibration(GRIPPER.profile, ((0, 0), (60_000, 60_000)))
    assert "node 0 opens" in only(doctor.check_table(small_table(), narrow)).sentence


class Drivers:
    """A stand-in for the drivers: connecting to the gripper returns a fake one, or raises `error`."""

    def __init__(self, error: Exception | None = None) -> None:
        self.rig, self.error = fake_cell([]), error

    def gripper(self, port: str, profile: object, *, read_only: bool):
        assert read_only
        if self.error is not None:
            raise self.error
        return self.rig.gripper

    def scan(self, port: str):
        return iter(())


def ran(words: str, drivers: Drivers) -> int:
    return run(parser().parse_args(words.split()), drivers)


def test_doctor_prints_findings_and_fails_if_one_is_bad(tmp_path, capsys):
    tree = tmp_path / "t.msgpack"
    dump(small_table(), tree)
    assert ran(f"--port tcp://doctor:1 --tree {tree}", Drivers()) == 0
    assert all(line.startswith("ok  ") for line in capsys.readouterr().out.splitlines())
    with pytest.raises(CheckFailedError, match="1 thing to put right"):
        ran("--port tcp://doctor:1 --json", Drivers(TimeoutError("silence")))
    record = json.loads(capsys.readouterr().out)
    assert record["fit"] is False
    assert [finding["verdict"] for finding in record["findings"]] == ["bad"]
    assert record["findings"][0]["remedy"]
    with pytest.raises(CheckFailedError):
        ran("--port tcp://doctor:1", Drivers(TimeoutError("silence")))
    assert "BAD  The gripper does not answer: silence. -> Check power" in capsys.readouterr().out


@pytest.mark.parametrize("make", ["{}", "dh://{}", "schunk://{}?unit=12"])
def test_doctor_serial_port_of_any_make_is_checked_before_opening(make, capsys):
    with pytest.raises(CheckFailedError):
        ran(f"--port {make.format('/dev/ttyUSB7')}", Drivers(AssertionError("opened")))
    assert "BAD  Port /dev/ttyUSB7 does not exist" in capsys.readouterr().out


def test_doctor_gripper_of_another_model_is_not_called_silent(capsys):
    error = OSError("it opens to 120 mm, a dh-ag95 to 95 mm; correct the model, or the port")
    with pytest.raises(CheckFailedError):
        ran("--port schunk://doctor:1 --gripper dh-ag95", Drivers(error))
    line = "BAD  The gripper cannot be opened: it opens to 120 mm, a dh-ag95 to 95 mm. -> Correct the model"
    assert line in capsys.readouterr().out


def test_check_port_of_simulated_cell_may_be_held_by_cell_only():
    """grasp-cell may hold the port, a terminal program may not; each runs in a separate process."""
    maker = "import os; m, s = os.openpty(); print(os.ttyname(s), flush=True); input()"
    holder = (
        "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print(flush=True); input()"
    )
    with _started(maker) as cell:
        terminal = cell.stdout.readline().strip()
        result = list(doctor.check_port(terminal))
        assert verdicts(result) == [Verdict.GOOD] * 3
        assert "pseudo-terminal" in result[1].sentence
        with _started(holder, terminal) as other:
            other.stdout.readline()
            held = list(doctor.check_port(terminal))[-1]
            assert held.verdict is Verdict.BAD
            assert f"(process {other.pid})." in held.sentence


@contextmanager
def _started(source: str, *words: str) -> Iterator["subprocess.Popen[str]"]:
    with started([sys.executable, "-c", source, *words], stdin=subprocess.PIPE) as process:
        yield process
        process.communicate("\n")
