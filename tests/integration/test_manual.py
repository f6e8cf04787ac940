"""A person acts as arm, as gripper or as both, through a pipe or at a terminal."""

import json
import os
import pty
import signal
from pathlib import Path

import pytest
from programs import RUNTIME, WAIT_S, ended, started
from sample_tables import changed, small_table
from written_journals import assert_sound

from drivers import connect, manual
from drivers.errors import ArmError, GripperFault, LinkError, PortError, ReadOnlyError
from runtime.commands import options
from runtime.commands.arguments import parser
from runtime.shell.errors import UsageError
from runtime.table import PROFILES, Place, dump

PERSON = ("--port", "manual", "--arm", "manual")


@pytest.fixture
def words(tree: Path) -> list[object]:
    journal = tree.with_name("j.jsonl")
    return [*RUNTIME, "--tree", tree, "--json", "--journal", journal, *PERSON]


def run(words: list[object], *said: str) -> tuple[int, list[dict[str, object]], list[str]]:
    """Runs a command while a person gives these answers, after which the input ends.

    Returns:
        Exit code, the printed objects, and the lines of standard error.
    """
    code, out, err = ended(words, input="".join(f"{line}\n" for line in said))
    return code, [json.loads(line) for line in out.splitlines()], err.splitlines()


def test_grasp_runtime_manual_arm_and_gripper_locate_part(
    words: list[object], tmp_path: Path
) -> None:
    said = ("", "", "29,9", "", "", "", "wide", "-3", "21.1", "", "")
    code, (part,), result = run(words, *said)
    assert (code, part["outcome"], part["leaf"], part["path"]) == (0, "leaf", 1, [0, 1])
    asked = [line for line in result if line.endswith(("press Enter", "nothing)?", "31.42:"))]
    assert [line.split()[0] for line in asked] == [
        *("Open", "Put", "Close", "Open", "Lift"),
        *("Put", "Close", "'wide'", "'-3'", "Open", "Lift"),
    ]
    where = "at (0.00, 0.00) mm, 0.0 deg, the tips 10.0 mm above the table"
    assert asked[1].startswith(f"Put the hand {where}")
    assert asked[5].startswith("Put the hand at (1.00, -2.00) mm, 90.0 deg")
    assert_sound(tmp_path / "j.jsonl")


def test_grasp_runtime_manual_tips_on_arc_asks_for_level_drags(words, tree):
    table = small_table()
    dump(changed(table, {"nodes.0.release": Place(5_000, 0)}), tree)
    said = ("", "", "29,9", "", "", "", "", "", "21.1", "", "")
    code, (part,), asked = run([*words, "--tips", "57.15,5"], *said)
    assert (code, part["leaf"]) == (0, 1)
    assert any("you keep the tips" in line for line in asked)
    questions = [line for line in asked if line.endswith(("press Enter", "nothing)?"))]
    assert [line.split()[0] for line in questions] == [
        *("Open", "Put", "Close", "Go", "Open", "Lift"),
        *("Put", "Close", "Open", "Lift"),
    ]
    assert all("10.0 mm above" in line for line in questions if line.startswith("Put"))


@pytest.mark.parametrize("arm", ["manual", "manual+tcp://127.0.0.1:1", "tcp://127.0.0.1:1"])
@pytest.mark.parametrize("port", ["manual", "/dev/x"])
def test_arc_of_manual_port_or_arm_is_none(arm: str, port: str) -> None:
    words = f"--tree t --port {port} --arm {arm} --tips 57.15,5"
    arguments = parser().parse_args(words.split())
    arc = options.arc_of(arguments, small_table(), None)
    assert (arc is None) == ("manual" in (port, arm.partition("+")[0]))
    arguments.tips = "57.15"
    with pytest.raises(UsageError, match="LINK,OFFSET"):
        options.arc_of(arguments, small_table(), None)


@pytest.mark.parametrize(("said", "code"), [([""], 20), ([], 21)])
def test_grasp_runtime_manual_end_of_input_is_fault(
    words: list[object], said: list[str], code: int
) -> None:
    end, (part,), _ = run(words, *said)
    assert (end, part["outcome"]) == (code, "fault")
    assert "standard input ended" in part["reason"]


def test_grasp_runtime_manual_ctrl_c_stops_and_earlier_input_is_ignored(words, tmp_path):
    main, child = pty.openpty()
    os.write(main, b"\n\n\n29.9\n")
    process = started(words, stdin=child)
    assert process.stderr is not None
    while not (line := process.stderr.readline()).startswith("Open"):
        assert line
    os.write(main, b"\n")
    while not (line := process.stderr.readline()).startswith("Put"):
        assert line
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=WAIT_S)
    os.close(main)
    os.close(child)
    (part,) = [json.loads(line) for line in out.splitlines()]
    assert (process.returncode, part["outcome"], part["path"]) == (40, "stopped", [])
    assert part["safe_state"][1] == "arm not moved: state unknown"
    assert_sound(tmp_path / "j.jsonl")


class Person:
    """A person who gives the same answer to all questions; the questions are recorded."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, answer: str = "") -> None:
        self.heard: list[str] = []
        monkeypatch.setattr(manual, "PERSON", self)
        self.answer: str | Exception = answer

    def ask(self, sentence: str, seconds: float) -> str:
        self.heard.append(sentence)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


def test_manual_arm_asks_for_placing_drag_and_lift_only(monkeypatch):
    person, arm = Person(monkeypatch), connect.arm("manual")
    places = ((3, 4, 60), (3, 4, 10), (5, 4, 10), (5, 4, 60))
    for target in ((0, 0, 60, 0.0), *((*place, 2.0) for place in places)):
        arm.move_linear(target, 100.0)
        assert arm.pose() == target
    assert [sentence.split()[0] for sentence in person.heard] == ["Put", "Go", "Lift"]
    with pytest.raises(ArmError, match="not moved"):
        arm.move_linear((float("nan"), 0.0, 0.0, 0.0), 100.0)
    person.answer = TimeoutError("nobody answered within 60 s")
    with pytest.raises(ArmError, match="state unknown since nobody answered"):
        arm.move_linear((5, 4, 10, 2.0), 100.0)
    with pytest.raises(ArmError, match="state unknown since nobody answered"):
        arm.pose()
    with pytest.raises(ReadOnlyError):
        connect.arm("manual", read_only=True).move_linear((0, 0, 60, 0.0), 100.0)


def test_manual_gripper_width_is_rounded_to_step_of_profile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    person, gripper = Person(monkeypatch, "42.5"), connect.gripper("manual")
    with pytest.raises(GripperFault, match="no move"):
        gripper.wait()
    gripper.move(-1, 20.0, 20.0)
    assert gripper.wait()[:2] == (PROFILES["robotiq-2f-85"].reading_um(round(42.5 * 227 / 85)), 2)
    person.answer = "0"
    gripper.move(-1, 20.0, 20.0)
    assert gripper.wait()[:2] == (0, 3)
    person.answer = EOFError("standard input ended")
    gripper.move(85_000, 20.0, 20.0)
    with pytest.raises(LinkError, match="standard input ended"):
        gripper.wait()
    for open_port in (connect.gripper, connect.arm):
        with pytest.raises(PortError):
            open_port("manual:1")
    with pytest.raises(PortError):
        connect.gripper("manual:a,b,c")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--port", "/dev/x", "--arm", "manual", "--put-down"], "put it down yourself"),
        (["--port", "manual", "--arm", "tcp://x:1", "--calibration", "f"], "you tell the width"),
    ],
)
def test_check_usage_option_unfit_for_manual_device_is_refused(
    more: list[str], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        options.check_usage(parser().parse_args(["--tree", "t", *more]))
