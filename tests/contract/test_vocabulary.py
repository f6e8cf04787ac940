"""Names in the code and words in the documentation follow tools/docs/glossary.md."""

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import chain
from pathlib import Path

import pytest
from documents import rows, section
from programs import ROOT

FOLDERS = ("planner", "runtime", "drivers", "tools", "tests")
GLOSSARY = ROOT / "tools" / "docs" / "glossary.md"
PATTERNS = ("README.md", "tools/d*/*.md", "runtime/**/*.md", "drivers/**/*.md")
PAGES = sorted(set(chain.from_iterable(map(ROOT.glob, PATTERNS))) - {GLOSSARY})
MOST_PARAMETERS = 8
SCRIPT = b"#!/usr/bin/env python3"


TERMS, NAMES_ROWS = (rows(section(GLOSSARY.read_text(), title)) for title in ("Terms", "Names"))
NAMES = {name.strip("`"): (where, better) for name, where, better in NAMES_ROWS}
WORDS = {
    word: term
    for term, _, replaced in TERMS
    for word in re.split(r", (?![^(]*\))", replaced)
    if "(" not in word and word != "-"
}


def modules_of(folder: str) -> Iterator[tuple[Path, list[ast.AST]]]:
    """The modules of a folder, each with its syntax nodes."""
    for path in sorted((ROOT / folder).rglob("*")):
        if path.suffix == ".py" or (path.is_file() and path.read_bytes().startswith(SCRIPT)):
            yield path.relative_to(ROOT), [*ast.walk(ast.parse(path.read_text()))]


@cache
def better_than(name: str) -> str | None:
    """What to use instead of an identifier; None where it may stay."""
    for word, (where, better) in NAMES.items():
        if name == word or (where == "in any name" and word in name.lower()):
            return better
    return None


def names_in(nodes: Iterable[ast.AST]) -> Iterator[tuple[int, str]]:
    """All identifiers of a module with their lines."""
    for node in nodes:
        line = getattr(node, "lineno", 0)
        match node:
            case ast.Name(id=name) | ast.arg(arg=name) | ast.Attribute(attr=name):
                yield line, name
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield line, name
            case ast.ClassDef(name=name) | ast.ExceptHandler(name=str(name)):
                yield line, name
            case ast.keyword(arg=str(name)) | ast.MatchAs(name=str(name)):
                yield line, name
            case ast.alias(name=name, asname=other):
                yield from ((line, part) for part in name.split("."))
                if other is not None:
                    yield line, other


def parameters_of(function: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) -> list[str]:
    """The parameters that a caller may give."""
    arguments = function.args
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    every += [extra for extra in (arguments.vararg, arguments.kwarg) if extra is not None]
    return [each.arg for each in every if each.arg not in ("self", "cls")]


def prose_of(page: str) -> str:
    """The text of a Markdown page without its code and its link addresses."""
    return re.sub(r"(?s:```.*?```)|`[^`\n]*`|\]\([^)]*\)", " ", page)


@pytest.mark.parametrize("folder", FOLDERS)
def test_identifiers_follow_glossary_and_parameters_are_few(folder):
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
    wrong = []
    for path, nodes in modules_of(folder):
        for line, name in [(0, path.stem), *names_in(nodes)]:
            if instead := better_than(name):
                wrong.append(f"{path}:{line}: {name}; better: {instead}")
        for node in nodes:
            if isinstance(node, kinds) and len(parameters_of(node)) > MOST_PARAMETERS:
                wrong.append(
                    f"{path}:{node.lineno}: more than {MOST_PARAMETERS} parameters, group some in a record"
                )
    assert not wrong, "\n".join(wrong)


def words_refused_in(prose: str) -> Iterator[str]:
    """Words that the glossary replaces, each with its term."""
    for word in re.findall(rf"\b(?:{'|'.join(WORDS)})\b", prose, re.IGNORECASE):
        yield f"{word}; say {WORDS.get(word.lower(), 'the term')}"


def test_pages_use_terms_of_glossary():
    wrong = [
        f"{path.relative_to(ROOT)}: {refused}"
        for path in PAGES
        for refused in words_refused_in(prose_of(path.read_text()))
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("folder", FOLDERS[:-1])
def test_docstrings_use_terms_of_glossary(folder):
    wrong = []
    for path, nodes in modules_of(folder):
        for node in nodes:
            match node:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    for refused in words_refused_in(prose_of(text)):
                        wrong.append(f"{path}:{node.lineno}: {refused}")
    assert not wrong, "\n".join(wrong)


def test_glossary_states_meaning_of_each_term():
    assert all(all(row) for row in TERMS)
    assert len({term for term, *_ in TERMS}) == len(TERMS)
    assert WORDS.keys() >= {"hasty"}
