"""The help of each command: purpose, arguments, examples that the command accepts, and exit codes."""

import argparse
import re
import shlex
from collections.abc import Iterator

import pytest
from command_parsers import parsers, subcommands

from planner.identification import pushes
from runtime.commands.squeezetree import PROGRAMS
from runtime.shell.exit_codes import ExitCode

COMMANDS = parsers()


def every(result: dict) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yields all commands and subcommands, each as its words and its parser."""
    for name, built in result.items():
        yield name, built
        if name == "squeezetree":  # its subcommands are the others
            continue
        yield from every({f"{name} {word}": one for word, one in subcommands(built).items()})


ALL = dict(every(COMMANDS))
LAST = [name for name, items in ALL.items() if not subcommands(items)]  # not `squeezetree` itself


def arguments(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    groups = argparse._SubParsersAction
    return [action for action in parser._actions if not isinstance(action, groups)]


@pytest.mark.parametrize("name", ALL)
def test_help_describes_command_and_each_argument(name):
    result = ALL[name]
    assert result.description
    assert result.description.rstrip()[-1] in ".?"
    assert [action.dest for action in arguments(result) if not action.help] == []
    assert [line for line in result.format_help().splitlines() if len(line) > 120] == []


@pytest.mark.parametrize("name", ALL)
def test_help_has_example_and_exit_codes(name):
    epilog = ALL[name].epilog or ""
    assert re.search(r"^examples?\b.*:$", epilog, re.MULTILINE)
    section = epilog.partition("exit codes:\n")[2].partition("\n\n")[0].rstrip("\n")
    lines = (line.split(maxsplit=1) for line in section.split("\n") if line.startswith("  "))
    listed = {int(code): sentence for code, sentence in lines}
    assert listed == {code: code.sentence for code in ExitCode if code in listed}
    assert {ExitCode.DONE, ExitCode.INTERNAL, ExitCode.USAGE} < listed.keys()


@pytest.mark.parametrize("name", ALL)
def test_help_example_is_understood(name):
    epilog = re.sub(r"\\\n\s+", "", ALL[name].epilog or "")
    lines = [line.strip() for line in epilog.splitlines() if line.startswith(f"  {name} ")]
    assert lines
    for line in lines:
        words = shlex.split(line.partition(" && ")[0].partition(" > ")[0])
        parser, given = ALL[name], words[len(name.split()) :]
        if name == "squeezetree":  # the program that it calls parses the rest
            parser, given = COMMANDS[PROGRAMS[given[0]].name], given[1:]
        parser.parse_args(given)


def test_help_of_identify_states_every_column():
    stated = set(re.findall(r"\w+", ALL["plan-identify"].epilog))
    assert {*pushes.COLUMNS, *pushes.DIRECTIONS} <= stated


def test_commands_that_print_text_offer_json():
    silent = {"grasp-audit judge"}  # JSON is all that it prints
    assert {name for name in LAST if "--json" not in ALL[name]._option_string_actions} == silent
