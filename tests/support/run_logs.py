"""Writes journals for tests from their specification, without the code of the runtime."""

import base64
import hashlib
import json

GENESIS = "0" * 64
STAMP = "2026-01-02T03:04:05.000Z"


def chained(entries, stamp=STAMP):
    """Returns the bytes of a journal with these entries, chained by digests.

    An entry without a time gets `stamp`. The entries are numbered from 0, but an entry whose `seq` is not
    an integer keeps this `seq`.
    """
    previous, lines = GENESIS, []
    for number, entry in enumerate(entries):
        odd = {"seq": entry["seq"]} if type(entry.get("seq", 0)) is not int else {}
        fields = {name: entry[name] for name in entry if name not in ("seq", "previous", "digest")}
        frame = {"seq": number, "time": stamp, **odd, **fields, "previous": previous}
        body = json.dumps(frame, separators=(",", ":")).encode()
        previous = hashlib.sha256(body).hexdigest()
        lines.append(body[:-1] + f',"digest":"{previous}"}}\n'.encode())
    return b"".join(lines)


def header(table):
    """Returns the first record of a run; `table` is the file of its table, as bytes."""
    return {
        "kind": "header",
        "table_sha256": hashlib.sha256(table).hexdigest(),
        "table_base64": base64.b64encode(table).decode(),
    }


def part(number, squeezes, outcome, leaf=None, reason=None):
    """The records of one part; each squeeze is (node, width [um], target)."""
    names = ("node", "width_um", "target")
    steps = [
        {"kind": "squeeze", "part": number, **dict(zip(names, squeeze, strict=True))}
        for squeeze in squeezes
    ]
    end = {"kind": "outcome", "part": number, "outcome": outcome, "leaf": leaf}
    return [{"kind": "part", "part": number}, *steps, {**end, "reason": reason, "audit": None}]
