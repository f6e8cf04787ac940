"""`grasp-runtime --plc opc.tcp://` as a command: a supervisor runs parts in the simulated cell."""

import asyncio
import json
import signal
import threading
import time
from math import degrees
from pathlib import Path
from typing import Any

import pytest
from asyncua import Client, ua
from plc_programs import PlcServed, free_port
from programs import REHEARSAL, TABLE, VIRTUAL, WAIT_S
from supervisor import Passport, Supervisor, passport
from written_journals import assert_sound

from runtime.cli import main
from runtime.journal.chain import records, verify
from runtime.plc.certificates import CERTIFICATE, PINNED
from runtime.plc.panel import AUTOMATIC, MACHINE, PACKML, RESULTS
from runtime.table import load

PARTS = 5
OUTCOMES = {"leaf": "located", "reject": "rejected", "unresolved": "unresolved"}


@pytest.fixture(scope="module")
def identity(tmp_path_factory: pytest.TempPathFactory) -> Passport:
    return passport(tmp_path_factory.mktemp("identity"), "identity")


class Program(threading.Thread):
    """A supervisor's program; it runs in a thread, since the command runs in the main thread."""

    def __init__(self, port: int, identity: Passport) -> None:
        super().__init__(daemon=True)
        self._port, self._identity = port, identity
        self.results: list[dict[str, Any]] = []
        self.events: list[str] = []
        self.counted: dict[str, int] = {}
        self.raised: BaseException | None = None

    def run(self) -> None:
        try:
            with Supervisor(self._port, self._identity) as line:
                line.follow()
                line.begin("rectangle")
                self.results += [line.part(f"plate {number}") for number in range(1, PARTS + 1)]
                names = [name.capitalize() for name in OUTCOMES.values()]
                self.counted = {name: line[f"{PACKML}/{name}"] for name in names}
                line.until(f"{MACHINE}/CurrentState", "Halted")
                until = time.monotonic() + WAIT_S
                while "SingleExecutionToHalted" not in line.events and time.monotonic() < until:
                    time.sleep(0.01)
                self.events = line.events
        except BaseException as error:
            self.raised = error
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)


@pytest.mark.slow
def test_opcua_server_results_equal_printed_and_journalled_parts(
    identity: Passport, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal, port = tmp_path / "j", free_port()
    program = Program(port, identity)
    program.start()
    words = [*VIRTUAL, *REHEARSAL, "--tree", str(TABLE), "--json", "--journal", str(journal)]
    code = main([*words, "--plc", f"opc.tcp://127.0.0.1:{port}", "--count", str(PARTS)])
    program.join()
    if program.raised is not None:
        raise program.raised
    parts = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(program.results) == len(parts) == PARTS
    assert code == max(part["exit_code"] for part in parts)
    digest = load(TABLE).digest
    for number, (result, part) in enumerate(zip(program.results, parts, strict=True), 1):
        assert result["Outcome"] == OUTCOMES[part["outcome"]]
        assert (result["MeasId"], result["TableDigest"]) == (f"plate {number}", digest)
        assert result["Seconds"] == pytest.approx(part["seconds"], abs=1e-4)
        pose = part["predicted_pose"] if part["outcome"] == "leaf" else None
        expected = (0.0, 0.0, 0.0)
        if pose is not None:
            expected = (pose["x_mm"], pose["y_mm"], degrees(pose["theta_rad"]))
        shown = [result[name] for name in ("X_mm", "Y_mm", "Angle_deg")]
        assert shown == pytest.approx(expected, abs=5.1e-4)
    outcomes = [result["Outcome"] for result in program.results]
    counts = {name.capitalize(): outcomes.count(name) for name in OUTCOMES.values()}
    assert program.counted == counts
    assert program.events[:2] == ["PreoperationalToInitialized", "InitializedToReady"]
    assert program.events.count("ReadyToSingleExecution") == PARTS
    assert program.events.count("SingleExecutionToReady") == PARTS - 1
    assert program.events[-1] == "SingleExecutionToHalted"
    assert_sound(journal)
    triggers = [each["trigger_id"] for each in records(journal) if each["kind"] == "trigger"]
    assert triggers == list(range(1, PARTS + 1))
    assert [int(result["ResultId"].rpartition("/")[2]) for result in program.results] == triggers
    pinned = (tmp_path / "j.opcua" / PINNED).read_bytes()
    assert pinned == identity.certificate.read_bytes()


@pytest.mark.slow
def test_opcua_server_abort_stops_part_safely_and_ends_server(tree, identity):
    more = ("--time-scale", "12", *REHEARSAL, "--plc-trusted", str(identity.certificate.parent))
    with PlcServed(tree, more=more, plc="opc.tcp://127.0.0.1:0") as served:
        with Supervisor(served.port, identity) as line:
            line.begin("small")
            first = line.part("a")
            job = line.start("b")
            served.until_squeezing(2)
            assert line.call(f"{AUTOMATIC}/Abort") == [0, ""]
            result = line.result(job)
            assert (result["Outcome"], result["ErrorId"]) == ("fault", 40)
            assert line[f"{MACHINE}/CurrentState"] == "Error"
            assert line[f"{PACKML}/StopReason"] == "stop request"
            line.release(result["ResultHandle"])
        code, parts, said = served.ended()
    assert code == 40
    assert [part["outcome"] for part in parts] == [parts[0]["outcome"], "stopped"]
    assert first["Outcome"] in ("located", "unresolved")
    assert parts[1]["safe_state"]
    assert verify(served.journal).closed
    assert "Traceback" not in said
    folder = served.journal.with_name("journal.jsonl.opcua")
    assert (folder / CERTIFICATE).exists()
    assert not (folder / PINNED).exists()


@pytest.mark.slow
def test_opcua_server_without_insecure_option_has_no_bare_endpoint(tree: Path) -> None:
    with PlcServed(tree, more=REHEARSAL, plc="opc.tcp://127.0.0.1:0") as served:
        client = Client(f"opc.tcp://127.0.0.1:{served.port}", timeout=WAIT_S)
        offered = asyncio.run(client.connect_and_get_server_endpoints())
    assert {each.SecurityMode for each in offered} == {ua.MessageSecurityMode.SignAndEncrypt}


@pytest.mark.slow
def test_opcua_server_insecure_has_bare_endpoint_and_keeps_result(tree: Path) -> None:
    more = ("--time-scale", "60", *REHEARSAL, "--plc-insecure")
    with PlcServed(tree, more=more, plc="opc.tcp://127.0.0.1:0") as served:
        with Supervisor(served.port) as line:
            line.begin("small")
            job = line.start("a")
            served.until_squeezing(1)
            line.vanish()
        with Supervisor(served.port) as line:
            result = line.result(job)
            assert result["MeasId"] == "a"
            assert not line[f"{MACHINE}/AutomaticSelected"]
            line.release(result["ResultHandle"])
            assert not line[f"{RESULTS}/ResultReady"]
            assert line[f"{MACHINE}/CurrentState"] == "Preoperational"
            (endpoint,) = line.wait(line.client.get_endpoints())
            assert endpoint.SecurityMode is ua.MessageSecurityMode.None_
        served.process.send_signal(signal.SIGTERM)
        code, parts, _ = served.ended()
    assert (code, len(parts)) == (40, 1)
    assert not served.journal.with_name("journal.jsonl.opcua").exists()
