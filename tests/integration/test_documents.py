"""Commands in documents are accepted by the programs that they name, and links lead to files.

Other integration tests run the blocks of the pages in `RUN`; the commands of all other pages are parsed by
the parsers of their programs. Commands within sentences are incomplete, so only their options and subcommands
are checked.
"""

import argparse
import importlib
import re
import shlex
import sys
import tomllib

import pytest
from command_parsers import subcommands
from documents import COMMANDS, DOCS, PAGES, blocks
from programs import ROOT, ended

RUN = {ROOT / "README.md"}
RUN |= {DOCS / name for name in ("tutorial.md", "from-a-solid.md", "commissioning.md")}
PARSED = {
    ROOT / "drivers" / "camera" / "README.md": "pictures are rendered for minutes",
    ROOT / "drivers" / "dh" / "README.md": "they need a gripper, or serve until they are stopped",
    ROOT / "drivers" / "schunk" / "README.md": "they need a gripper",
    DOCS / "python.md": "they install; tests/integration/test_python_page.py runs its Python",
    DOCS / "drivers.md": "tests/integration/test_driver_guide.py runs its example otherwise",
    DOCS / "acceptance.md": "tests/unit/runtime/spc/study/test_study_command.py runs it",
    DOCS / "evidence.md": "tests/integration/test_evidence.py runs it",
    DOCS / "refit.md": "tests/integration/test_pages.py runs it with fewer parts",
    DOCS / "plc.md": "it serves until it is stopped; tests/integration/test_plc.py does so",
    DOCS / "studio.md": "it serves until it is stopped; tests/integration/test_studio.py runs it",
    DOCS / "results.md": "each command measures for minutes, some need MuJoCo",
}
SENTENCE = re.compile(r"`((?:plan|grasp)-[a-z]+ [^`]+)`")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
FILE = re.compile(r"(?<![\w/.-])(?:planner|runtime|drivers|tests|tools|trees)/[\w./*@-]*[\w*]/?")
MODULE = re.compile(r"`((?:planner|runtime|drivers)(?:\.\w+)+)[`:]")
# Stored tables of results may name files that no longer exist.
KEPT = re.compile(r"^<!-- table .*?^<!-- end -->$", re.MULTILINE | re.DOTALL)
REMOVED = re.compile(r"^### Removed$.*?^### ", re.MULTILINE | re.DOTALL)  # of a changelog
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = set(PROJECT["optional-dependencies"])


class Parsed(BaseException):
    """Ends a command once its arguments are accepted, before it does anything."""


def understand(words, monkeypatch):
    """Lets a command only parse its words; returns the parser, and whether it accepted them."""
    asked = []
    original = argparse.ArgumentParser.parse_args

    def parse_args(self, args=None, namespace=None):
        asked.append(self)
        original(self, args, namespace)
        raise Parsed

    module, _, function = COMMANDS[words[0]].partition(":")
    with monkeypatch.context() as patched:
        patched.setattr(argparse.ArgumentParser, "parse_args", parse_args)
        patched.setattr(sys, "argv", list(words))
        # The files that examples name do not exist here.
        patched.setattr("planner.commands.missing_input", lambda _: None)
        try:
            getattr(importlib.import_module(module), function)()
        except Parsed:
            return asked[-1], True
        except SystemExit as ended:
            return (asked[-1] if asked else None), ended.code == 0
    raise AssertionError(f"{words[0]} parses no arguments")


def options_of(parser):
    """The options of a parser and of its subcommands."""
    return set(parser._option_string_actions).union(*map(options_of, subcommands(parser).values()))


def typed(line):
    """The commands of a shell line, each as its words without redirections."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    commands, skip = [[]], False
    for word in lexer:
        if skip:
            skip = False
        elif set(word) <= set("();<>|&"):
            skip = not set(word).isdisjoint("<>")
            if not skip:
                commands.append([])
        else:
            commands[-1].append(word)
    return [words for words in commands if words and "=" not in words[0]]


def check_words(words, monkeypatch):
    """Checks that a whole command is accepted by its program."""
    if words[0] in COMMANDS:
        assert understand(words, monkeypatch)[1], shlex.join(words)
        for inner in (word.split(" ", 1) for word in words if " " in word):
            if inner[0] in COMMANDS:
                check_words(shlex.split(" ".join(inner)), monkeypatch)
    elif words[:2] == ["pip", "install"]:
        asked = re.findall(r"\w+", " ".join(re.findall(r"\[(.*?)\]", " ".join(words))))
        assert set(asked) <= EXTRAS, words
    elif words[0].startswith("tools/") or words[0] == "python":
        script, *arguments = words[1:] if words[0] == "python" else words
        text = (ROOT / script).read_text()
        for word in arguments:
            assert f'"{word}"' in text or not word.startswith("--"), f"{script} has no {word}"
            numbers = word.replace(",", "").isdigit()
            read = numbers or (ROOT / word).is_file()
            assert word.startswith("--") or f'"{word}"' in text or read or word in METHODS, word


METHODS = set(importlib.import_module("comparison").METHODS)
EACH_PAGE = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


@EACH_PAGE
def test_documents_commands_in_blocks_are_accepted(page, monkeypatch, capsys):
    result = blocks(page)
    assert not result or page in RUN or page in PARSED, "run its blocks, or say in PARSED why not"
    for block in result:
        assert block.commands, "a block of commands has lines that begin with $"
        for line in block.commands:
            for words in typed(line):
                check_words(words, monkeypatch)


def check_sentence(text, monkeypatch):
    """Checks that the options and subcommands of an incomplete command exist."""
    command, *words = shlex.split(text.replace("\\|", "|").replace("[", "").replace("]", ""))
    assert command in COMMANDS, text
    inner = words and words[0][:1].islower() and "." not in words[0]
    first = [words[0].split("|")[0]] if inner else []
    parser, _ = understand([command, *first], monkeypatch)
    if first and subcommands(parser):
        assert set(words[0].split("|")) <= subcommands(parser).keys(), text
    for word in words:
        assert not word.startswith("--") or word in options_of(parser), f"{text}: no {word}"
        if word.partition(" ")[0] in COMMANDS:
            check_sentence(word, monkeypatch)


@EACH_PAGE
def test_documents_commands_in_sentences_have_named_options(page, monkeypatch, capsys):
    for text in SENTENCE.findall(REMOVED.sub("", page.read_text())):
        check_sentence(text, monkeypatch)


@pytest.fixture(scope="module")
def known_options():
    """The options of all commands and tools."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        inner = {"grasp-calibrate": "camera tag pictures", "grasp-audit": "judge report study"}
        lines = [[name] for name in COMMANDS]
        lines += [[name, word] for name in inner for word in inner[name].split()]
        result = set().union(*(options_of(understand(words, monkeypatch)[0]) for words in lines))
    tools = [path for path in (ROOT / "tools").iterdir() if path.is_file()]
    for path in [*tools, *(ROOT / "tests" / "bench").glob("*.py"), *(DOCS / "site").glob("*.py")]:
        result |= set(OPTION.findall(path.read_text()))
    return result


@EACH_PAGE
def test_documents_named_options_and_commands_exist(page, known_options):
    text = REMOVED.sub("", page.read_text())
    assert set(OPTION.findall(text)) <= known_options
    assert set(re.findall(r"(?<![\w/.-])(?:plan|grasp)-[a-z]+\b(?!\.)", text)) <= set(COMMANDS)


@EACH_PAGE
def test_documents_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text())
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []


@EACH_PAGE
def test_documents_named_files_and_modules_exist(page):
    text = KEPT.sub("", page.read_text())
    named = set(FILE.findall(text)) | {name.replace(".", "/") for name in MODULE.findall(text)}
    assert [name for name in sorted(named) if not _exists(name.rstrip("/"))] == []


def _exists(name):
    """Whether a name is a file or folder of the repository, or is defined in one of its modules."""
    module, _, attribute = name.rpartition("/")
    files = (ROOT / f"{module}.py", ROOT / module / "__init__.py")
    above = (path for path in files if path.exists())
    known = (re.search(rf"\b{re.escape(attribute)}\b", path.read_text()) for path in above)
    return any((*ROOT.glob(name), *ROOT.glob(f"{name}.py"))) or any(known)


def test_readme_first_block_shows_commands_of_demo():
    demo = (ROOT / "tools" / "demo").read_text()
    values = dict(re.findall(r"^(\w+)=(\S+)$", demo, re.MULTILINE))
    lines = re.findall(r"^show (.+?)(?: \|.*)?$", demo, re.MULTILINE)
    shown = [re.sub(r"\$(\w+)", lambda m: values[m[1]], line.replace('"', "")) for line in lines]
    first = blocks(ROOT / "README.md")[0].commands
    assert "/bin/activate" in demo.rstrip().splitlines()[-1]
    assert first == ["tools/demo", ". .venv/bin/activate", *shown]


def test_readme_states_lack_of_hardware_runs_before_first_figure():
    text = (ROOT / "README.md").read_text()
    assert text.index("never run on hardware") < re.search(r"\d+(\.\d+)? ?(mm|%)", text).start()


@pytest.mark.parametrize("script", ["check", "coverage", "demo", "site", "wheel"])
def test_tools_script_help_prints_usage_and_runs_nothing(script, tmp_path):
    """The script runs in a folder without pyproject.toml, where it could not install or run anything."""
    (tmp_path / "tools").mkdir()
    for name in (script, "environment"):
        (tmp_path / "tools" / name).write_text((ROOT / "tools" / name).read_text())
    code, out, err = ended(["bash", f"tools/{script}", "--help"], cwd=tmp_path)
    assert (code, err) == (0, "")
    assert f"    tools/{script}\n" in out or f"    tools/{script} " in out
    assert "set -euo" not in out


def test_demo_unknown_option_is_refused_in_one_line():
    done = ended([ROOT / "tools" / "demo", "--fast"])
    assert (done.code, done.out, done.one_line) == (2, "", True)


@pytest.mark.parametrize(
    "wrong",
    [
        "plan-init a.dxf --gripper robotiq-2f-99 -o a.toml",
        "grasp-journal burn a.jsonl",
        "tools/table1 --rowz 3",
        "pip install squeezetree[gum]",
        "python tests/bench/bench_squeeze.py --only sped",
    ],
)
def test_check_words_wrong_command_raises(wrong, monkeypatch, capsys):
    with pytest.raises(AssertionError):
        check_words(wrong.split(), monkeypatch)


@pytest.mark.parametrize(
    "wrong", ["grasp-runtime --tre T", "grasp-journal show|burn J", "plan-fly --json"]
)
def test_check_sentence_wrong_command_raises(wrong, monkeypatch, capsys):
    with pytest.raises(AssertionError):
        check_sentence(wrong, monkeypatch)


def test_typed_splits_shell_line_into_commands():
    commands = typed("a=$(b); plan-x y > z & grasp-q | tee log")
    assert commands == [["b"], ["plan-x", "y"], ["grasp-q"], ["tee", "log"]]
