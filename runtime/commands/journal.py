"""The command `grasp-journal`: shows, verifies, replays and exports the journals of runs."""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

from runtime.devices.clock import date
from runtime.errors import JournalError
from runtime.journal import export
from runtime.journal.chain import records, verify
from runtime.journal.lines import RESERVED, UPTIME, Entry, begins_run
from runtime.journal.replay import Replay
from runtime.journal.times import times_of
from runtime.shell.command import (
    Commands,
    Parser,
    add_command,
    named_path,
    natural,
    run,
    say_result,
    seconds,
)
from runtime.shell.errors import UsageError
from runtime.shell.exit_codes import ExitCode, epilog
from runtime.shell.files import usable, words_of
from runtime.shell.plain_text import cleaned
from runtime.traversal.results import Outcome

EXIT_CODES = epilog(ExitCode.JOURNAL)
EPILOG = f"""\
examples:
  grasp-journal show squeezetree-journal.jsonl --outcome reject
  grasp-journal show squeezetree-journal.jsonl --times --takt 6s
  grasp-journal verify squeezetree-journal.jsonl
  grasp-journal replay squeezetree-journal.jsonl
  grasp-journal export squeezetree-journal.jsonl -o squeezes.csv

{EXIT_CODES}"""
VERIFIED = ("records", "runs", "segments", "closed", "head")
# fields that `show` leaves out of its lines
HIDDEN = RESERVED | UPTIME | {"table_base64", "calibration_um"}
EXAMPLES = {"show": " --outcome reject", "export": " -o squeezes.csv"}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    return run(parser(), argv, lambda arguments: int(arguments.run(arguments)))


def parser() -> Parser:
    """Builds the argument parser of `grasp-journal`."""
    text = "Read, verify, replay and export the journals of grasp-runtime."
    built = Parser(prog="grasp-journal", description=text, epilog=EPILOG)
    subcommands = built.add_subparsers(required=True, metavar="show | verify | replay | export")
    shown = _subcommand(subcommands, "show", _show, "print the journal's records, one line each")
    add = shown.add_argument
    add("--part", type=natural, metavar="N", help="only records of this part")
    add("--node", type=natural, metavar="N", help="only squeezes at this node")
    add("--outcome", choices=[each.value for each in Outcome], help="only parts that ended so")
    text = "only from this time on, e.g. 2026-11-21T09:00 (UTC)"
    add("--since", type=_since, metavar="TIME", help=text)
    add("--times", action="store_true", help="print instead the mean seconds of each phase")
    text = "with --times: also the share of parts done within this time"
    add("--takt", type=seconds, metavar="6s", help=text)
    _subcommand(subcommands, "verify", _verify, "check every line's digest and the chain")
    _subcommand(
        subcommands, "replay", _replay, "derive every decision again from readings and table"
    )
    exported = _subcommand(subcommands, "export", _export, "one row a squeeze as CSV")
    text = "file.csv; - for standard output"
    exported.add_argument("-o", "--output", type=Path, required=True, metavar="F", help=text)
    return built


def _subcommand(subcommands: Commands, name: str, body: object, help_text: str) -> Parser:
    example = f"grasp-journal {name} squeezetree-journal.jsonl{EXAMPLES.get(name, '')}"
    command = add_command(subcommands, help_text, example, EXIT_CODES)
    text = "the journal; its sealed segments are read with it"
    command.add_argument("journal", type=named_path, help=text)
    which = "a record" if name == "show" else "instead of text"
    command.add_common(f"print one JSON object {which}")
    command.set_defaults(run=body)
    return command


def _verify(arguments: argparse.Namespace) -> int:
    seen = verify(arguments.journal)
    end = "ended" if seen.closed else "is under way, or BROKE OFF"
    where = f" and {seen.segments + 1} files" if seen.segments else ""
    counted = f"{seen.records} records in {seen.runs} runs{where}"
    line = f"{arguments.journal}: {counted} verify; the last run {end}"
    say_result(arguments.json, {name: getattr(seen, name) for name in VERIFIED}, [line])
    return 0


def _replay(arguments: argparse.Namespace) -> int:
    replay = Replay()
    findings = list(replay.follow(_entries(arguments.journal)))
    entries = [finding._asdict() for finding in findings]
    whole = f"{arguments.journal}: {replay.decisions} decisions derived again, all as recorded"
    lines = [f"record {finding.seq}: {finding.sentence}" for finding in findings] or [whole]
    say_result(arguments.json, {"decisions": replay.decisions, "findings": entries}, lines)
    if findings:
        raise JournalError(
            arguments.journal, f"{len(findings)} records contradict those before them"
        )
    return 0


def _show(arguments: argparse.Namespace) -> int:
    if arguments.takt is not None and not arguments.times:
        raise UsageError("--takt is for --times; state both, or leave it out")
    if arguments.times:
        return _show_times(arguments)
    ended = None
    if arguments.outcome is not None:
        numbered = _numbered(records(arguments.journal))
        wanted = ("outcome", arguments.outcome)
        ended = {
            part for part, entry in numbered if (entry["kind"], entry.get("outcome")) == wanted
        }
    for part, entry in _numbered(_entries(arguments.journal)):
        if not _is_wanted(arguments, entry) or (ended is not None and part not in ended):
            continue
        try:
            print(json.dumps(entry) if arguments.json else cleaned(_line(entry)))
        except BrokenPipeError:  # the reader has seen enough
            break
    return 0


def _show_times(arguments: argparse.Namespace) -> int:
    wanted = (entry for entry in _entries(arguments.journal) if _is_wanted(arguments, entry))
    entries = (entry for entry in wanted if arguments.outcome in (None, entry.get("outcome")))
    if arguments.node is not None:
        raise UsageError("--times is of whole parts; leave out --node")
    try:
        result = times_of(entries, arguments.takt)
    except ValueError as error:
        raise JournalError(arguments.journal, f"an outcome's {error}") from error
    say_result(arguments.json, result.fields(), result.lines())
    return 0


def _export(arguments: argparse.Namespace) -> int:
    output = usable(arguments.output, arguments.journal, stdout=True)
    rows = export.write_rows(export.rows(_entries(arguments.journal)), output, "--output")
    line = json.dumps({"rows": rows, "output": str(output)})
    print(line if arguments.json else f"{rows} squeezes written to {output}", file=words_of(output))
    return 0


def _entries(path: Path) -> Iterator[dict[str, object]]:
    entries = records(path)
    first = next(entries, None)
    if first is None:
        raise JournalError(path, "is empty")
    return chain([first], entries)


def _numbered(entries: Iterator[dict[str, object]]) -> Iterator[tuple[tuple[int, str], Entry]]:
    """Yields each record with a key that identifies its part: the number of the run and that of the part.

    The number of the part alone does not suffice, since each run counts its parts from 1.
    """
    run = 0
    for entry in entries:
        run += begins_run(entry)
        yield (run, _short(entry.get("part"))), entry


def _is_wanted(arguments: argparse.Namespace, entry: Entry) -> bool:
    if arguments.part is not None and entry.get("part") != arguments.part:
        return False
    if arguments.node is not None and entry.get("node") != arguments.node:
        return False
    try:
        return arguments.since is None or date(str(entry["time"])) >= arguments.since
    except ValueError:
        message = f"record {entry['seq']} has a time that is no date; leave out --since"
        raise JournalError(arguments.journal, message) from None


def _since(text: str) -> object:
    try:
        return date(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no date as 2026-11-21 or 2026-11-21T09:00"
        ) from None


def _line(entry: Entry) -> str:
    """Writes a record as a line for people: number, time and kind, then all fields but those in `HIDDEN`."""
    shown = (f"{name}={_short(value)}" for name, value in entry.items() if name not in HIDDEN)
    return f"{entry['seq']:>6} {entry['time']} {entry['kind']:<8} {' '.join(shown)}"


def _short(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))


if __name__ == "__main__":
    sys.exit(main())
