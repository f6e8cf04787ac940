"""`--dry-run`, `--check` and `grasp-doctor` write nothing to the devices, as taps on the wire show."""

import contextlib
import json
from pathlib import Path

import pytest
from programs import called
from sample_tables import small_table
from tapped_devices import POWERED_UP, READS, WRITES, TappedArm, TappedGripper

from drivers import connect
from drivers.errors import LinkTimeout, ReadOnlyError
from runtime.cli import doctor, main

PING, READ_POSE, READ_JOINTS, CLOSE = 0, 3, 4, 99
QUESTIONS = {PING, READ_POSE, READ_JOINTS, CLOSE}


@pytest.fixture(autouse=True)
def _beside_the_table(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tree.parent)


def test_dry_run_sends_only_reads_and_prints_each_node(tree: Path) -> None:
    with TappedGripper() as gripper, TappedArm() as arm:
        words = ("--tree", tree, "--port", gripper.path, "--arm", arm.url, "--dry-run")
        ended = called(main, *words)
        assert ended.code == 0
        assert gripper.functions
        assert set(gripper.functions) <= READS
        # Only these frames, of 8 bytes each, were sent.
        assert len(gripper.heard) == 8 * len(gripper.functions)
        assert set(arm.codes) <= QUESTIONS
    printed = ended.out.splitlines()
    assert sum(line.startswith("node ") for line in printed) == len(small_table().nodes)
    assert "nothing was written" in printed[-1]
    assert not list(tree.parent.glob("*.jsonl"))


def test_activate_read_only_is_refused_and_taps_record_a_real_one() -> None:
    with TappedGripper() as tapped, TappedArm() as answering:
        tapped.block = POWERED_UP
        looking = connect.gripper(tapped.path, read_only=True)
        with contextlib.closing(looking), pytest.raises(ReadOnlyError, match="dry run"):
            looking.activate()
        assert set(tapped.functions) <= READS
        with pytest.raises(LinkTimeout):
            connect.gripper(tapped.path).activate()
        assert set(tapped.functions) & WRITES
        connect.arm(answering.url).close()
        assert set(answering.codes) - QUESTIONS


def test_check_and_dry_run_json_print_one_document_each(tree: Path) -> None:
    def document(*words: str) -> dict[str, object]:
        code, out, _ = called(main, "--tree", tree, "--json", *words)
        assert code == 0
        return json.loads(out)

    with TappedGripper() as gripper, TappedArm() as arm:
        checked = document("--port", gripper.path, "--check")
        record = document("--port", gripper.path, "--arm", arm.url, "--dry-run")["sentences"]
    assert set(gripper.functions) <= READS
    assert checked == {"nodes": 2, "gripper": {"reading_mm": 85.0, "width_mm": 85.0}}
    assert sum(sentence.startswith("node ") for sentence in record) == 2
    assert document("--check") == {"nodes": 2, "gripper": None}


def test_grasp_doctor_healthy_cell_reports_no_fault_and_only_reads(tree: Path) -> None:
    with TappedGripper() as gripper, TappedArm() as arm:
        code, out, _ = called(doctor, "--port", gripper.path, "--arm", arm.url, "--tree", tree)
        assert code == 0
        assert set(gripper.functions) <= READS
        assert set(arm.codes) <= QUESTIONS
    assert "BAD" not in out
    shown = "The table fits|exists and may be opened|active and stands at 85.00 mm|readings|arm"
    assert all(line in out for line in shown.split("|"))
