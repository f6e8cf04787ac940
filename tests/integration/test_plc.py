"""`grasp-runtime --plc` as a process: a PLC's program, by pymodbus' client and in structured text."""

import json
import signal
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from math import degrees
from pathlib import Path

import pytest
from ladder import Ladder
from plc_programs import (
    FLAGS,
    INPUTS,
    OUTPUTS,
    SOURCE,
    MemoryPlc,
    PlcServed,
    by_pymodbus,
    free_port,
    in_structured_text,
)
from plc_study import Program
from programs import REHEARSAL, TABLE, VIRTUAL
from structured_text import FunctionBlock
from written_journals import assert_sound

from runtime.cli import main
from runtime.journal.chain import records, verify
from runtime.plc import station
from runtime.plc.registers import READ, READ_AT, WRITTEN, WRITTEN_AT

PARTS = 10
OUTCOMES = ("leaf", "reject", "unresolved", "fault")
LADDER = SOURCE.with_name("plc.ladder.txt")


@pytest.mark.slow
@pytest.mark.parametrize("program", [by_pymodbus, in_structured_text])
def test_modbus_server_results_equal_printed_and_journalled_parts(
    program: Callable[[int, int], list[dict[str, int]]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(station, "HEARTBEAT_LIMIT_S", 1e6)  # the machine may be busy
    journal, port = tmp_path / "j", free_port()
    words = [*VIRTUAL, *REHEARSAL, "--tree", str(TABLE), "--json", "--journal", str(journal)]
    with ThreadPoolExecutor(1) as pool:
        taken = pool.submit(program, port, PARTS)
        code = main([*words, "--plc", f"modbus-tcp://127.0.0.1:{port}", "--count", str(PARTS)])
        lines = taken.result()
    parts = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(lines) == len(parts) == PARTS
    assert code == max(part["exit_code"] for part in parts)
    for answer, part in zip(lines, parts, strict=True):
        assert answer["outcome"] == OUTCOMES.index(part["outcome"]) + 1
        pose = part["predicted_pose"] if part["outcome"] == "leaf" else None
        expected = (0, 0, 0)
        if pose is not None:
            expected = (1e3 * pose["x_mm"], 1e3 * pose["y_mm"], 1e4 * degrees(pose["theta_rad"]))
        assert [answer[name] for name in ("x", "y", "angle")] == pytest.approx(expected, abs=0.51)
    assert_sound(journal)
    triggers = [each["trigger_id"] for each in records(journal) if each["kind"] == "trigger"]
    assert triggers == list(range(1, PARTS + 1))


def test_plc_structured_text_behaves_as_study_program() -> None:
    block, twin, plc = FunctionBlock(SOURCE.read_text()), Program(), MemoryPlc()
    ends = 0
    for cycle in range(400):
        plc.now += 0.1
        values: dict[str, object] = {
            entry: bool(plc[name]) if name in FLAGS else plc[name] for name, entry in INPUTS.items()
        }
        words = plc.station.read(READ_AT, READ[-1].address + READ[-1].words - READ_AT, plc.now)
        number = ends % 0xFFFF + 1
        result = block(start=True, id=number, **values)
        twin.cycle(words, number)
        assert [result[name] for name in OUTPUTS] == twin.image()[: len(OUTPUTS)]
        assert result["state"] == twin.state
        ends += bool(result["done"])
        assert plc.station.write(WRITTEN_AT, twin.image(), plc.now) is None
        if plc.station.order is not None and cycle % 5 == 0:
            plc.end_part(x=cycle)
        if cycle % 37 == 0:
            plc.station.disconnect()
    assert ends > 20


def test_ladder_with_interruptions_takes_each_result_once() -> None:
    ladder, plc = Ladder(LADDER.read_text()), MemoryPlc()
    number, age, taken, begun = 1, 0, [], []
    for cycle in range(3000):
        plc.now += 0.1 if cycle % 331 else 5.0  # a pause so long that the PLC is no longer enabled
        if cycle % 37 == 0:
            plc.station.disconnect()
        values = {register.name: plc[register.name] for register in READ}
        memory = ladder(start=1, id=number, **values)
        if memory["done"]:
            taken.append((memory["trigger_id"], memory["part_outcome"], memory["part_x"]))
            number += 1
        words = [memory.get(register.name, 0) for register in WRITTEN]
        assert plc.station.write(WRITTEN_AT, words, plc.now) is None
        age = age + 1 if plc.station.order is not None else 0
        if age > cycle % 7:
            begun.append(plc.station.order.trigger_id)
            # Every tenth part ends in a fault, which leaves its error.
            code = (0, 20)[begun[-1] % 10 == 0]
            plc.end_part(outcome=4 if code else 1, x=-3 * begun[-1], exit_code=code)
    assert len(taken) > 200
    assert taken == [(each, 4 if each % 10 == 0 else 1, -3 * each) for each in begun[: len(taken)]]
    assert begun == list(range(1, len(begun) + 1))


@pytest.mark.parametrize("source", [SOURCE, LADDER])
def test_plc_sample_runtime_restarted_during_part_locates_it_again(source: Path) -> None:
    program = FunctionBlock(SOURCE.read_text()) if source is SOURCE else Ladder(LADDER.read_text())
    plc, ended, restarted = MemoryPlc(), 0, False
    for _ in range(60):
        values = {register.name: plc[register.name] for register in READ}
        if source is SOURCE:
            values = {
                entry: bool(values[name]) if name in FLAGS else values[name]
                for name, entry in INPUTS.items()
            }
        result = program(start=True, id=5, **values)
        words = [int(result.get(register.name, 0)) for register in WRITTEN]
        assert plc.station.write(WRITTEN_AT, words, plc.now) is None
        ended += bool(result["done"])
        if ended:
            break
        if plc.station.order is not None and plc["trigger"] == 0:
            if restarted:
                plc.end_part(x=7)
            else:
                plc.station, restarted = MemoryPlc().station, True
    assert (restarted, ended) == (True, 1)


@pytest.mark.slow
def test_modbus_server_disconnect_or_stop_keeps_result_of_busy_id(tree):
    with PlcServed(tree, more=("--time-scale", "12", *REHEARSAL)) as served:
        with served.plc() as plc:
            plc.begin(77)
            served.until_squeezing(1)
            plc.client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        with served.plc() as plc:
            plc.wait("result_valid", 1)
            assert (plc["result_id"], plc["enable"]) == (77, 0)
            assert plc.result(77)["outcome"] in (1, 3)
            plc.begin(78)
            served.until_squeezing(2)
            served.process.send_signal(signal.SIGTERM)
            result = plc.result(78)
            assert (result["outcome"], result["exit_code"], result["error_id"]) == (4, 40, 40)
        code, parts, _ = served.ended()
    assert code == 40
    assert [part["outcome"] for part in parts] == [parts[0]["outcome"], "stopped"]
    assert parts[1]["safe_state"]
    assert verify(served.journal).closed
