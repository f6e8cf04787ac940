"""Common parts of the tools: paths of the checkout, its virtual environment, and the command-line parser."""

import argparse
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TREES = ROOT / "trees"
RESULTS = ROOT / "tests" / "bench" / "results"
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]


def parser(doc: str | None) -> argparse.ArgumentParser:
    """A parser named after the tool, with the tool's docstring as its help."""
    shape = argparse.RawDescriptionHelpFormatter
    name = f"tools/{Path(sys.argv[0]).name}"
    return argparse.ArgumentParser(name, description=doc, formatter_class=shape)


def enter() -> None:
    """Restarts the tool with the Python of the checkout's .venv, unless this is missing or runs already."""
    python = ROOT / ".venv" / "bin" / "python"
    if python.exists() and Path(sys.prefix) != python.parents[1]:
        os.execv(python, [str(python), *sys.argv])
