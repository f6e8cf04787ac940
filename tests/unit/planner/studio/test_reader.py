"""The process that reads drawings, and its replacement when it dies or hangs."""

import sys
from contextlib import closing

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


@pytest.fixture
def reader(tmp_path):
    with closing(Reader(tmp_path)) as reader:
        yield reader


def test_ask_after_the_process_dies_starts_another(reader, monkeypatch):
    monkeypatch.setattr(readers, "READER", [sys.executable, "-c", ECHO])
    assert reader.ask(["a"]) == {"words": ["a"]}
    with pytest.raises(InputError, match="bomb: reading it takes too much"):
        reader.ask(["bomb"])
    assert reader.ask(["b"]) == {"words": ["b"]}


def test_ask_beyond_its_patience_is_an_error(reader, monkeypatch):
    monkeypatch.setattr(readers, "READER", [sys.executable, "-c", "import time; time.sleep(600)"])
    monkeypatch.setattr(readers, "PATIENCE_S", 0.1)
    with pytest.raises(InputError):
        reader.ask(["slow"])
