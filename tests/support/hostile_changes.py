"""Changes sound files so that they are almost right: text, bytes, values of JSON, records of journals."""

import contextlib
import json
import re
from random import Random

from run_logs import chained

from runtime.shell import strict_json

LONGEST = 1 << 20  # most bytes that the repetitions of a line have
# Numbers and words that replace others in a text file.
WORDS = """-1 0 nan inf -inf 1e400 1e308 1e-320 0x10 1_000 true null "" [] {} 1979-05-27 ' " \\
../../etc/passwd %s%n =1+1 &a; É"""
ODD = (*WORDS.split(), "9" * 25, "9" * 5000, "[" * 2000, "{" * 2000, "<!ENTITY a 'a'>", "")
ODD += ("\x00", "\x1b[2J", "\u202e")
MILD = (b"0", b"-1", b"1", b"2", b"0.001", b"-0.5", b"1e3", b"1e6", b"1e9", b"90", b"360")
NUMBERS = (-1, 0, 2**31, 2**63, 10**18, 1.5, -0.0, 1e308, float("nan"), float("inf"))
TEXTS = ("", "zzz", "\x00", "\ud800", "x" * 5000, "2026-01-01", "header", "end")
STRANGE = (None, True, *NUMBERS, *TEXTS, [], {}, [[]], {"a": 1}, [0] * 300)


def text(data: bytes, random: Random) -> bytes:
    """Damages text: replaces numbers and words, and removes, repeats or moves lines."""
    for _ in range(random.choice((1, 1, 2, 4))):
        action = random.randrange(10)
        if action < 6:
            numbers = [*re.finditer(rb"-?\d[\d.eE+-]*", data)]
            words = [*re.finditer(rb"\"[^\"\n]*\"|\b[A-Za-z_]+\b", data)]
            if action < 3:  # a number in place of a number
                result, put = numbers, random.choice((*MILD, *(hit[0] for hit in numbers[:40])))
            else:
                result, put = numbers + words, random.choice(ODD).encode()
            if result:
                hit = random.choice(result)
                data = data[: hit.start()] + put + data[hit.end() :]
        elif action < 8:
            lines = data.splitlines(keepends=True) or [b""]
            at, to = random.randrange(len(lines)), random.randrange(len(lines))
            line = lines.pop(at)
            if action == 7:
                times = min(random.choice((1, 2, 500)), 1 + LONGEST // (1 + len(line)))
                lines[to:to] = [line] * times
            data = b"".join(lines)
        else:
            data = damaged(data, random)
    return data


def damaged(data: bytes, random: Random) -> bytes:
    """Damages bytes: cuts, removes, inserts or doubles some, or changes line ends or encoding."""
    at = random.randrange(len(data) + 1)
    noise, gap = random.randbytes(random.choice((1, 2, 60))), random.choice((1, 3, 100))
    parts = (data[:at], data[at:], data[:at] + data[at + gap :], data + data, b"")
    more = (data[:at] + put + data[at:] for put in (noise, b"\xff\xfe\x00"))
    lines = (data.replace(b"\n", end) for end in (b"\r\n", b""))
    encoded = (b"\xef\xbb\xbf" + data, data.decode("latin-1").encode("utf-16"))
    return random.choice((*parts, *more, *lines, *encoded))


def odd(value: object, random: Random) -> object:
    """A copy of a JSON value with one change: an entry removed, added, doubled or replaced."""
    if isinstance(value, dict) and value and random.random() < 0.95:
        name = random.choice(sorted(value))
        action = random.randrange(10)
        if action == 0:
            return {key: inner for key, inner in value.items() if key != name}
        if action == 1:
            return {**value, random.choice(("odd", "", "part")): random.choice(STRANGE)}
        return {**value, name: odd(value[name], random)}
    if isinstance(value, list) and value and random.random() < 0.9:
        at = random.randrange(len(value))
        action = random.randrange(6)
        if action == 0:
            return value[:at] + value[at + 1 :]
        if action == 1:
            return value[:at] + [value[at]] * 2 + value[at + 1 :]
        return [*value[:at], odd(value[at], random), *value[at + 1 :]]
    if type(value) in (int, float) and random.random() < 0.5:
        return random.choice((value + 1, -value, value * 1000, str(value), value / 7))
    if random.random() < 0.05:
        deep: object = 0
        for _ in range(300):
            deep = [deep]
        return deep
    return random.choice(STRANGE)


def journal(data: bytes, random: Random) -> bytes:
    """Changes one or two records of a journal and corrects the digests, or damages the journal's text."""
    if random.random() < 0.25:
        return text(data, random)
    entries = [json.loads(line) for line in data.splitlines()]
    for _ in range(random.choice((1, 1, 2))):
        at, action = random.randrange(len(entries)), random.randrange(8)
        if action == 0 and len(entries) > 1:
            del entries[at]
        elif action == 1:
            entries.insert(random.randrange(len(entries)), entries[at])
        else:
            changed = odd(entries[at], random)
            entries[at] = changed if isinstance(changed, dict) else entries[at]
    return chained(entries, None)


def sealed(data: bytes, random: Random) -> bytes:
    """Changes a value of a JSON document and corrects the document's digest, or damages the text."""
    if random.random() < 0.3:
        return text(data, random)
    document = json.loads(data)
    del document["sha256"]
    document = odd(document, random)
    with contextlib.suppress(ValueError, UnicodeEncodeError):  # some texts have no digest
        if isinstance(document, dict):
            document["sha256"] = strict_json.digest(document)
    return json.dumps(document).encode()


def values(data: bytes, random: Random) -> bytes:
    """Changes a value of a JSON document, or damages the document's text."""
    if random.random() < 0.3:
        return text(data, random)
    return json.dumps(odd(json.loads(data), random)).encode()
