"""Shared by all benchmarks: the import path of the tests' helpers, the command line, the files of results."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support"), str(ROOT / "tools")]
sys.path.append(str(ROOT / "tools" / "docs" / "site"))


class Shape(argparse.RawDescriptionHelpFormatter, argparse.ArgumentDefaultsHelpFormatter):
    """A format of help texts: the description as it is written, and each option with its default."""


def parser(doc: str | None) -> argparse.ArgumentParser:
    """A parser of the command line, whose help shows the script's docstring."""
    return argparse.ArgumentParser(description=doc, formatter_class=Shape)


def show(row: object) -> None:
    """Prints figures as a line of JSON, with four digits each."""
    digits = json.loads(json.dumps(row), parse_float=lambda text: float(f"{float(text):.4g}"))
    print(json.dumps(digits), flush=True)


class Kept:
    """The file of results of a benchmark: `results/NAME.json`."""

    def __init__(self, name: str) -> None:
        self.path = Path(__file__).parent / "results" / f"{name}.json"

    def read(self, otherwise: Any) -> Any:
        """The content of the file, or `otherwise` if there is no file."""
        return json.loads(self.path.read_text("utf-8")) if self.path.exists() else otherwise

    def write(self, record: object) -> None:
        """Replaces the content of the file by a record."""
        self.path.write_text(json.dumps(record, indent=1) + "\n", "utf-8")

    def write_rows(self, rows: list[dict[str, Any]]) -> None:
        """Replaces the content of the file by rows, one a line."""
        self.path.write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n", "utf-8")
