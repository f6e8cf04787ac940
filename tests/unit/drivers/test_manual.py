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
