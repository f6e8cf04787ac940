"""A PLC as master of a run: options that contradict it, and how each end of a part reaches the PLC."""

import json
import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest
from fake_cell import FakeCell, Log, State, fake_cell
from plc_programs import TcpPlc
from sample_tables import changed, small_table
from squeezes import AT_21, AT_30, AT_36

from runtime.cli import main
from runtime.commands import options, plc
from runtime.commands.arguments import parser
from runtime.commands.recipe import prepare
from runtime.errors import JournalError
from runtime.execution import crash
from runtime.journal.chain import Journal, records
from runtime.journal.replay import Replay
from runtime.monitoring.monitor import Views
from runtime.plc.registers import as_json
from runtime.shell.errors import UsageError
from runtime.shell.interrupts import StopRequests
from runtime.table import dump

PLC = ["--tree", "t", "--port", "sim", "--plc", "modbus-tcp://127.0.0.1:0"]


@pytest.fixture(autouse=True)
def _patient(monkeypatch):
    """Makes a run wait long enough for a slow PLC, which closes its connection at the end."""
    for name in ("FAREWELL_S", "ENDING_S", "GLANCE_S"):
        monkeypatch.setattr(plc, name, 30.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        *((f"--plc {url}", "write modbus-tcp") for url in ("modbus-tcp://", "127.0.0.1:5020")),
        *((f"--plc {url}", "write modbus-tcp") for url in ("tcp://h:1", "modbus-rtu:///dev/ttyS0")),
        ("--plc opc.tcp://127.0.0.1:4840/cell", "write modbus-tcp"),
        ("--plc modbus-tcp://127.0.0.1:5020/x", "write modbus-tcp"),
        ("--plc opc.tcp://127.0.0.1", "--plc opc.tcp://127.0.0.1: write modbus-tcp"),
        ("--plc modbus-tcp://127.0.0.1:99999", "the port from 1 to 65535"),
        *((f"--plc modbus-tcp://127.0.0.1:{port}", "PORT") for port in ("99999", "port")),
        *((f"--plc modbus-tcp://{host}:5020", "--network") for host in ("192.0.2.1", "0.0.0.0")),
        ("--plc opc.tcp://192.0.2.1:4840", "--network"),
        ("--plc-insecure", "--plc-insecure is for opc.tcp"),
        ("--plc-trusted f", "--plc-trusted is for opc.tcp"),
        ("--plc opc.tcp://127.0.0.1:0 --plc-insecure --plc-trusted f", "uses no certificates"),
        *((more, "leave it out") for more in ("--serve tcp://127.0.0.1:0", "--check", "--dry-run")),
        *((more, "leave it out") for more in ("--put-down", "--after-crash resume")),
        *((f"--tree u {more}", "leave it out") for more in ("--http 0", "--audit see")),
    ],
)
def test_check_usage_options_contradicting_plc_are_refused(words, said):
    with pytest.raises(UsageError, match=said):
        options.check_usage(parser().parse_args([*PLC, *words.split()]))


def test_plc_map_is_printed_without_table(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--plc-map", "json"])
    assert ended.value.code == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(as_json()))
    with pytest.raises(SystemExit) as ended:
        main(["--plc-map", "xml"])
    assert ended.value.code == 2


class Running:
    """A run in the main thread, with a cell in memory; the PLC's program runs in another thread."""

    def __init__(
        self, folder: Path, rig: FakeCell, *trees: Path, count=None, journal=Journal
    ) -> None:
        self.journal = journal(folder / "j.jsonl", lambda: "")
        self._cell = replace(rig.cell, journal=self.journal)
        words = [word for tree in trees for word in ("--tree", str(tree))]
        words += ["--json", "--activate", "--journal", str(folder / "j")]
        words += ["--count", str(count)] if count else []
        arguments = parser().parse_args([*PLC[2:], *words])
        self._stack = ExitStack()
        self.recipes = [prepare(arguments, tree) for tree in trees]
        self._run = plc.opened(arguments, self.recipes, Views(), self._stack)
        self.port = int(self._run._url.rpartition(":")[2])
        self.raised: BaseException | None = None

    def kept(self) -> list[dict[str, object]]:
        """The records of the journal; checks that it verifies and replays without findings."""
        kept = list(records(self.journal.path))
        assert list(Replay().follow(kept)) == []
        return kept

    def run(self, program: Callable[[TcpPlc], None]) -> int:
        """Runs the cell while a PLC's program runs in a thread; returns the run's exit code.

        Raises:
            Exception: what the program or the run raised.
        """

        def with_plc() -> None:
            try:
                with TcpPlc(self.port) as client:
                    program(client)
            except BaseException as error:
                self.raised = error
                os.kill(os.getpid(), signal.SIGTERM)

        thread, first = threading.Thread(target=with_plc), self.recipes[0]
        with StopRequests(), self._stack, self.journal:
            crash.begin(self.journal, None, first.loaded.data, first.header, crash.ABORT)
            thread.start()
            try:
                return self._run.run(self._cell)
            finally:
                thread.join()
                if self.raised is not None:
                    raise self.raised


def test_plc_run_part_reports_outcome_code_and_pose_if_located(tmp_path, tree, capsys):
    results = []

    def program(client):
        client.enable()
        results.extend(client.part(number) for number in (5, 5, 65535))

    running = Running(tmp_path, fake_cell([AT_21, AT_36, AT_30, AT_36]), tree, count=3)
    assert running.run(program) == 10
    assert [result["outcome"] for result in results] == [1, 2, 3]
    assert [result["exit_code"] for result in results] == [0, 10, 10]
    poses = [(each["x"], each["y"], each["angle"]) for each in results]
    assert poses == [(0, 500, 0), (0, 0, 0), (0, 0, 0)]
    printed = [json.loads(line)["outcome"] for line in capsys.readouterr().out.splitlines()]
    assert printed == ["leaf", "reject", "unresolved"]
    triggers = [each["trigger_id"] for each in running.kept() if each["kind"] == "trigger"]
    assert triggers == [5, 5, 65535]


def test_plc_run_connection_before_start_is_refused(tmp_path, tree):
    running = Running(tmp_path, fake_cell([AT_21]), tree, count=1)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", running.port), 1.0)
    assert running.run(lambda client: (client.enable(), client.part(1))) == 0


def test_plc_run_before_enable_moves_nothing(tmp_path, tree):
    rig = fake_cell([AT_21])
    rig.gripper.now = State(activated=False)

    def program(client):
        client.write(trigger=1)
        assert client["error_id"] == 101
        client.write(trigger=0)
        time.sleep(0.05)
        assert (rig.log.named("activate"), rig.log.named("move_linear")) == ([], [])
        client.enable()
        assert client.part(1)["outcome"] == 1

    assert Running(tmp_path, rig, tree, count=1).run(program) == 0
    assert len(rig.log.named("activate")) == 1


def withdrawing(
    rig: FakeCell, withdrawn: threading.Event, enables_again: bool = False
) -> Callable[[TcpPlc], None]:
    """A PLC's program that withdraws enable before anything moves, and then has another part located.

    If `enables_again`, it does so before the runtime looks, without another trigger.
    """

    def program(client: TcpPlc) -> None:
        client.enable()
        client.begin(6)
        client.write(enable=0)
        if enables_again:
            client.enable()
        withdrawn.set()
        result = client.result(6)
        assert (result["outcome"], result["exit_code"]) == (4, 40)
        assert rig.log.named("move_linear") == []
        client.enable()
        assert client.part(7)["outcome"] == 1

    return program


def activated_after(event: threading.Event) -> FakeCell:
    """A cell whose gripper is not active, and whose activation lasts until the event."""
    rig = fake_cell([AT_21])
    rig.gripper.now = State(activated=False)
    sweep = rig.gripper.activate

    def slow_sweep():
        event.wait(30)
        sweep()

    rig.gripper.activate = slow_sweep
    return rig


@pytest.mark.parametrize("enables_again", [False, True])
def test_plc_run_enable_withdrawn_before_part_moves_nothing(tmp_path, tree, enables_again):
    triggered = threading.Event()
    rig = activated_after(triggered)
    running = Running(tmp_path, rig, tree, count=1)
    assert running.run(withdrawing(rig, triggered, enables_again)) == 0
    triggers = [each for each in running.kept() if each["kind"] == "trigger"]
    assert [(each["trigger_id"], each["part"]) for each in triggers] == [(6, None), (7, 1)]


def test_plc_run_enable_withdrawn_before_first_look_ends_part(tmp_path, tree, monkeypatch):
    """On a busy controller both trigger and withdrawal have arrived when the run first looks."""
    rig, withdrawn, note = fake_cell([AT_21]), threading.Event(), plc.ForPlc.note

    def late(monitor, sentence):
        note(monitor, sentence)
        withdrawn.wait(30)

    monkeypatch.setattr(plc.ForPlc, "note", late)  # the first note says that a PLC may connect

    assert Running(tmp_path, rig, tree, count=1).run(withdrawing(rig, withdrawn)) == 0


def test_plc_run_fault_is_result_that_stays_until_acknowledged(tmp_path, tree, monkeypatch):
    monkeypatch.setattr(plc, "FAREWELL_S", 0.1)

    def program(client):
        client.enable()
        client.part(1)
        client.begin(2)
        client.wait("result_valid", 1)
        time.sleep(0.3)  # longer than a run that was stopped would wait
        assert client["result_id"] == 2
        assert (client["outcome"], client["error_id"], client["x"]) == (4, 21, 0)
        client.write(enable=0, trigger_id=3)
        client.write(enable=1, trigger=1)
        assert client["error_id"] == 107
        client.write(trigger=0)
        assert client.result(2)["outcome"] == 4

    running = Running(tmp_path, fake_cell([AT_21, AT_21], Log(40, ConnectionError("cable"))), tree)
    assert running.run(program) == 21
    assert running.kept()[-1]["exit_code"] == 21


def test_plc_run_journal_error_is_fault_of_part_under_way(tmp_path, tree):
    def program(client):
        client.enable()
        client.begin(4)
        assert client.result(4)["exit_code"] == 24

    class Full(Journal):
        def record(self, kind, fields):
            if kind == "trigger":
                raise JournalError(self.path, "cannot be written")
            super().record(kind, fields)

    rig = fake_cell([AT_21])
    with pytest.raises(JournalError):
        Running(tmp_path, rig, tree, journal=Full).run(program)
    assert rig.log.named("move_linear") == []


def test_plc_run_stop_between_parts_ends_run(tmp_path, tree):
    def program(client):
        client.enable()
        client.part(1)
        os.kill(os.getpid(), signal.SIGTERM)

    running = Running(tmp_path, fake_cell([AT_21]), tree)
    with pytest.raises(KeyboardInterrupt):
        running.run(program)
    end = running.kept()[-1]
    assert (end["kind"], end["parts"], end["exit_code"]) == ("end", 1, 40)


def test_plc_run_stop_before_triggered_part_begins_records_its_trigger(tmp_path, tree):
    struck = threading.Event()

    def program(client):
        client.enable()
        client.begin(9)
        os.kill(os.getpid(), signal.SIGTERM)
        struck.set()
        result = client.result(9)
        assert (result["outcome"], result["exit_code"]) == (4, 40)

    running = Running(tmp_path, activated_after(struck), tree)
    with pytest.raises(KeyboardInterrupt):
        running.run(program)
    *_, trigger, end = running.kept()
    assert (trigger["kind"], trigger["trigger_id"], trigger["part"]) == ("trigger", 9, None)
    assert end["kind"] == "end"


def test_plc_run_stop_ends_wait_for_acknowledge(tmp_path, tree):
    def program(client):
        client.enable()
        client.begin(1)
        client.wait("result_valid", 1)
        os.kill(os.getpid(), signal.SIGTERM)

    assert Running(tmp_path, fake_cell([AT_21]), tree, count=1).run(program) == 0


def test_plc_run_change_of_table_starts_new_run(tmp_path, tree):
    other = tmp_path / "u.msgpack"
    dump(changed(small_table(), {"tool": "squeezetree other"}), other)

    def program(client):
        client.enable()
        for number, chosen in enumerate((1, 1, 0), 1):
            client.write(table=chosen)
            assert client.part(number)["outcome"] == 1
            assert client["table_in_use"] == chosen
            assert client["table_digest"] == int(running.recipes[chosen].loaded.digest[:8], 16)
        client.write(table=2, trigger=1)
        assert client["error_id"] == 104
        client.write(trigger=0)
        os.kill(os.getpid(), signal.SIGTERM)

    running = Running(tmp_path, fake_cell([AT_21] * 3), tree, other)
    with pytest.raises(KeyboardInterrupt):
        running.run(program)
    kinds = [str(each["kind"]) for each in running.kept()]
    runs = " ".join(kind for kind in kinds if kind in ("header", "trigger", "end"))
    assert runs == "header end header trigger trigger end header trigger end"


@pytest.mark.parametrize("starts", [True, False])
def test_plc_run_failing_server_ends_run_and_journal(starts, tmp_path, tree, monkeypatch):
    async def failing(server, stop):
        if starts:
            server.started.set()
        server._listener.close()
        raise OSError("no descriptor is left")

    monkeypatch.setattr(plc.ModbusServer, "serve", failing)
    monkeypatch.setattr(TcpPlc, "__init__", lambda *_: None)
    monkeypatch.setattr(TcpPlc, "close", lambda _: None)
    running = Running(tmp_path, fake_cell([]), tree)
    with pytest.raises(OSError, match="no descriptor"):
        running.run(lambda _: None)
    end = running.kept()[-1]
    assert (end["kind"], end["parts"]) == ("end", 0)


def test_plc_run_tables_for_different_grippers_are_refused(tmp_path, tree):
    other = tmp_path / "u.msgpack"
    dump(changed(small_table(), {"gripper.finger_width_um": 1000}), other)
    with pytest.raises(UsageError, match="another gripper"):
        Running(tmp_path, fake_cell([]), tree, other)
