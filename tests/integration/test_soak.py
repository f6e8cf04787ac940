"""Short runs of `tools/soak` and `tools/hostile displaced`, and checks that both detect faulty code."""

import json
import sys
from collections import Counter
from dataclasses import replace

import pytest
from hostile_displaced import campaign
from programs import REHEARSAL, ended
from soaking import SCRIPT, small_setting, small_soak, soak_run

from drivers.robotiq.gripper import Gripper
from drivers.sim.faults import KINDS, Seeded
from drivers.sim.virtual.cell import VirtualCell
from runtime.execution.hand import Hand
from runtime.traversal.results import PartResult


def script(*arguments):
    words = [sys.executable, SCRIPT, "--json", *REHEARSAL, *arguments]
    code, out, _ = ended(words, timeout=250)
    return code, json.loads(out.splitlines()[-1]), out


def test_soak_under_random_faults_has_no_findings():
    code, result, out = script("--transactions", "8000")
    assert (code, result["findings"]) == (0, 0), out
    assert result["transactions"] >= 8_000
    assert len(result["faults_met"]) >= 24
    assert set(result["outcomes"]) <= {"leaf", "unresolved", "reject", "fault", "not connected"}


def test_soak_same_seed_and_other_workers_is_identical():
    """Without injected faults, no part ends in a fault."""
    words = ("--runs", "3", "--parts-per-run", "10", "--no-faults", "--seed")
    code, alone, out = script(*words, "40")
    assert (code, alone["crashes"], alone["runs"]) == (0, 0, 3), out
    assert alone["outcomes"].keys() <= {"leaf", "unresolved", "reject"}
    assert script(*words, "40", "--workers", "2")[1] == alone


def runs(count=12):
    findings = []
    for seed in range(count):
        findings += soak_run.run(small_soak(4, faults=True), seed).findings
    return " / ".join(findings)


def test_soak_driver_that_moves_without_look_is_reported(monkeypatch):
    look = Gripper.state
    seen = {}

    def once(self):
        if self not in seen or sys._getframe(1).f_code.co_name not in ("move", "ready_gripper"):
            seen[self] = look(self)
        return seen[self]

    monkeypatch.setattr(Gripper, "state", once)
    assert "without a look" in runs()


def test_soak_leaf_that_contradicts_records_is_reported(monkeypatch):
    sound = PartResult.of

    def careless(part, outcome, *more, **fields):
        result = sound(part, outcome, *more, **fields)
        return replace(result, leaf=1 - result.leaf) if result.leaf in (0, 1) else result

    monkeypatch.setattr(PartResult, "of", careless)
    assert "the path leads to" in runs(20)


def test_seeded_faults_depend_on_seed_and_part_and_reach_all_kinds():
    met = Counter()
    for part in range(400):
        assert Seeded(3).of_part(part) == Seeded(3).of_part(part)
        met.update(fault.kind for fault in Seeded(3).of_part(part))
    assert set(met) == set(KINDS)
    assert [Seeded(3).of_part(k) for k in range(50)] != [Seeded(4).of_part(k) for k in range(50)]


def test_virtual_cell_same_seed_exchanges_same_bytes():
    def transcript():
        cell = VirtualCell(small_setting(), 1, Seeded(1))
        said = []
        send, receive = cell._gripper_port.send, cell._gripper_port.receive
        cell._gripper_port.send = lambda data: (said.append(data), send(data))[1]

        def heard(seconds):
            said.append((cell.clock.now(), data := receive(seconds)))
            return data

        cell._gripper_port.receive = heard
        gripper = cell.gripper()
        gripper.activate()
        gripper.move(-1, 71.0, 62.0)
        gripper.wait()
        return said

    assert transcript() == transcript()


PARTS = range(30)


def displaced(reports: list[str]) -> dict[str, int]:
    setting = small_setting()
    return dict(campaign(setting, setting.subject, PARTS, 1, reports.append))


def test_hostile_displaced_arm_is_fault_only_above_tolerance() -> None:
    reports: list[str] = []
    ends = displaced(reports)
    assert reports == []
    assert ends == {"above the tolerance: a fault": 27, "below the tolerance: no fault": 3}


def test_hostile_displaced_arm_without_check_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    where = Hand.where

    def believing(hand: Hand) -> tuple[float, float, float, float]:
        hand._sent_to = None
        return where(hand)

    monkeypatch.setattr(Hand, "where", believing)
    reports: list[str] = []
    ends = displaced(reports)
    assert ends["FAILED above the tolerance: no fault of the arm"] == len(reports) == 27
