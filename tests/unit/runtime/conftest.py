"""What every unit test of the runtime needs."""

import os

import pytest


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch):
    """No test cuts the supply, so records need not have reached the disk before the next one."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
