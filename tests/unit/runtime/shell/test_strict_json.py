"""JSON from outside: read as the standard library does, or refused with a sentence."""

import json

import pytest

from runtime.shell.strict_json import MOST_DIGITS, MOST_LEVELS, parse


@pytest.mark.parametrize(
    "value",
    [
        {"a": [1, -2.5, None, True, "\u00e9", {"b": []}]},
        10**MOST_DIGITS - 1,
        "\U0001f600",
        json.loads("[" * MOST_LEVELS + "]" * MOST_LEVELS),
    ],
    ids=["mixed", "long", "pair", "deep"],
)
def test_parse_valid_json_equals_standard_library(value):
    data = json.dumps(value, ensure_ascii=False).encode()
    assert parse(json.dumps(value)) == parse(data) == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not JSON: Expecting value"),
        ("{'a': 1}", "not JSON"),
        (b"\xff", "not JSON: 'utf-8'"),
        (json.dumps({"a": 1}).encode("utf-16"), "not JSON"),
        ("[" * (MOST_LEVELS + 1) + "]" * (MOST_LEVELS + 1), "nested too deeply"),
        ("[" * 200_000, "nested too deeply"),
        ("9" * (MOST_DIGITS + 1), "a number of 20 digits"),
        ("[NaN]", "NaN, which is no finite number"),
        ("-Infinity", "-Infinity, which is no finite number"),
        ("1e999", "1e999, which is no finite number"),
        ('"\\ud800"', "half a character"),
    ],
)
def test_parse_invalid_or_unusable_json_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        parse(text)
