"""The process that reads drawings: when it dies of one, the next gets another."""

import sys

import pytest

from planner.studio import reader as readers
from planner.studio.reader import Reader
from runtime.shell.errors import InputError

ECHO = """
import json, sys
for line in sys.stdin:
    words = json.loads(line)
    if words[0] == "bomb": sys.exit(9)
    print(json.dumps({"words": words}), flush=True)
"""


def test_a_drawing_that_ends_the_reader_is_an_error_and_the_next_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(readers, "READER", [sys.executable, "-c", ECHO])
    reader = Reader(tmp_path)
    try:
        assert reader.ask(["a"]) == {"words": ["a"]}
        with pytest.raises(InputError, match="bomb: reading it takes too much"):
            reader.ask(["bomb"])
        assert reader.ask(["b"]) == {"words": ["b"]}
    finally:
        reader.close()


def test_a_drawing_that_takes_too_long_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(readers, "READER", [sys.executable, "-c", "import time; time.sleep(600)"])
    monkeypatch.setattr(readers, "PATIENCE_S", 0.1)
    reader = Reader(tmp_path)
    with pytest.raises(InputError):
        reader.ask(["slow"])
    reader.close()
