"""A person as the gripper, without a terminal."""

import pytest

from drivers import manual
from drivers.errors import LinkError
from runtime.table import PROFILES


def test_manual_gripper_closed_before_wait_asks_nobody(monkeypatch):
    asked = []
    monkeypatch.setattr(manual.PERSON, "ask", lambda *sentence: asked.append(sentence))
    gripper = manual.ManualGripper(PROFILES["robotiq-2f-85"], read_only=False)
    gripper.move(20_000, 50.0, 40.0)
    gripper.close()
    with pytest.raises(LinkError, match="was closed"):
        gripper.wait()
    assert not asked


def test_manual_gripper_unanswered_question_leaves_its_width_unknown(monkeypatch):
    def nobody(*_):
        raise EOFError("standard input has ended")

    monkeypatch.setattr(manual.PERSON, "ask", nobody)
    gripper = manual.ManualGripper(PROFILES["robotiq-2f-85"], read_only=False)
    gripper.move(-1, 50.0, 40.0)
    with pytest.raises(LinkError, match="width is not known"):
        gripper.wait()
    with pytest.raises(LinkError, match="width is not known"):
        gripper.state()
