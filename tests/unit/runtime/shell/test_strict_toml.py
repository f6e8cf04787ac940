"""TOML of unknown origin: a text that tomllib would parse for minutes is refused at once."""

import tomllib
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.shell.strict_toml import MOST_BYTES, MOST_LEVELS, parse

DEEP = 100_000
NESTED = {
    "dotted key": ".".join("a" * DEEP) + " = 1",
    "dotted digits": "1." * DEEP + "1 = 1",
    "spaced key": " . ".join("a" * DEEP) + " = 1",
    "quoted key": ".".join(['"a"'] * 50_000) + " = 1",
    "header": "[" + ".".join("a" * DEEP) + "]",
    "list header": "[[" + ".".join("a" * DEEP) + "]]",
    "list": "a = " + "[" * DEEP + "]" * DEEP,
    "inline tables": "a = " + "{a=" * DEEP + "1" + "}" * DEEP,
    "behind a string": 'a = """x"""\nb = ' + "[" * DEEP,
    "behind a comment": "# '''\n" + ".".join("a" * DEEP) + " = 1",
}


@pytest.mark.parametrize("text", NESTED.values(), ids=NESTED)
def test_parse_deep_nesting_is_refused_before_tomllib_reads_it(text, monkeypatch):
    monkeypatch.setattr(tomllib, "loads", None)
    with pytest.raises(ValueError, match="nested too deeply"):
        parse(text)


def test_parse_large_text_is_refused():
    with pytest.raises(ValueError, match="larger than 1 MiB"):
        parse("#" * (MOST_BYTES + 1))


@pytest.mark.parametrize(
    "text",
    [
        "a.b.c.d = 1",
        "[a.b]\nc = [[1.5, 2.5], [3.5]]\nd = {e = {f = 1}}",
        'a = "[[[[[[[[[[[[[[[[[[[[[[[["',
        "a = '.......................'",
        "# [[[[[[[[[[[[[[[[[[[[[[[[ a.b.c.d.e.f.g.h.i.j.k.l.m.n.o.p.q",
        'a = """\n[[[[[[[[[[[[[[[[[[[[\\""" " \n"""',
        "a = [" + ", ".join(["1.25"] * 1_000) + "]",
        "a = " + "[" * MOST_LEVELS + "]" * MOST_LEVELS,
    ],
)
def test_parse_ordinary_text_equals_tomllib(text):
    assert parse(text) == tomllib.loads(text)


@given(st.text(alphabet="ab.=[]{}\"'#\n\\ 1,", max_size=MOST_LEVELS))
def test_parse_any_short_text_equals_tomllib(text):
    """So short a text cannot be nested deeply enough to be refused."""
    assert outcome(parse, text) == outcome(tomllib.loads, text)


def outcome(read: Callable[[str], object], text: str) -> object:
    """The value that `read` returns for a text, or the message of its ValueError."""
    try:
        return read(text)
    except ValueError as error:
        return str(error)
