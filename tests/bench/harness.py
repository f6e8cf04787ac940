"""What benchmarks share: the tests' helpers, the form of a command line, the files of kept figures."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support"), str(ROOT / "tools")]
sys.path.append(str(ROOT / "tools" / "docs" / "site"))


class Shape(argparse.RawDescriptionHelpFormatter, argparse.ArgumentDefaultsHelpFormatter):
    """The docstring as it is, and each option with its default."""


def parser(doc: str | None) -> argparse.ArgumentParser:
    """A parser with the script's docstring as its help."""
    return argparse.ArgumentParser(description=doc, formatter_class=Shape)


def show(row: object) -> None:
    """Print figures, with four digits each, in a line."""
    digits = json.loads(json.dumps(row), parse_float=lambda text: float(f"{float(text):.4g}"))
    print(json.dumps(digits), flush=True)


class Kept:
    """The file of a benchmark in `results/`."""

    def __init__(self, name: str) -> None:
        self.path = Path(__file__).parent / "results" / f"{name}.json"

    def read(self, otherwise: Any) -> Any:
        """What is kept; something else where nothing is."""
        return json.loads(self.path.read_text("utf-8")) if self.path.exists() else otherwise

    def write(self, record: object) -> None:
        """Keep figures in the place of those before."""
        self.path.write_text(json.dumps(record, indent=1) + "\n", "utf-8")

    def write_rows(self, rows: list[dict[str, Any]]) -> None:
        """Keep rows, one a line."""
        self.path.write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n", "utf-8")
