"""For every unit test of the runtime: files are not synced to the disk."""

import os

import pytest


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch):
    """Omits syncs to the disk, which protect from a power cut: no test cuts the power."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
