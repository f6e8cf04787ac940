"""The rectangle of the paper's Table I: its job as a file and as text, and its table."""

from pathlib import Path

from programs import JOB, TABLE

JOB_PATH, TABLE_PATH = JOB, TABLE
TEXT = JOB_PATH.read_text(encoding="utf-8")


CERTAIN = ("chance = 0.8", "chance = 0.0")
"""The passage of the job that states doubts about the cell, and a replacement without doubts."""


def edited(old: str, new: str) -> str:
    """Returns the text of the rectangle's job, with the passage `old` replaced by `new`."""
    assert TEXT.count(old) == 1, f"the test expects {old!r} once in the rectangle's job"
    return TEXT.replace(old, new)


def quick_job(path: Path, search: str, *change: str) -> Path:
    """Writes the rectangle's job to `path` with a section [search] of the lines `search`; returns the path.

    `change`, if given, is a passage of the job and its replacement.
    """
    text = edited(*change) if change else TEXT
    path.write_text(f"{text}\n[search]\n{search}\n", encoding="utf-8")
    return path
