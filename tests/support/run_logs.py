"""Journals for tests: chained as the runtime chains them, written here from their specification alone."""

import base64
import hashlib
import json

GENESIS = "0" * 64


def chained(entries):
    """The lines of a journal, as bytes."""
    previous, lines = GENESIS, []
    for seq, entry in enumerate(entries):
        frame = {
            "seq": seq,
            "time": f"2026-01-01T00:00:{seq % 60:02d}",
            **entry,
            "previous": previous,
        }
        body = json.dumps(frame, separators=(",", ":")).encode()
        previous = hashlib.sha256(body).hexdigest()
        lines.append(body[:-1] + f',"digest":"{previous}"}}\n'.encode())
    return b"".join(lines)


def header(table):
    """The first record of a run of a table's bytes."""
    return {
        "kind": "header",
        "table_sha256": hashlib.sha256(table).hexdigest(),
        "table_base64": base64.b64encode(table).decode(),
    }


def part(number, squeezes, outcome, leaf=None, reason=None):
    """The records of one part; squeezes are (node, width in um, target)."""
    steps = [
        {
            "kind": "squeeze",
            "part": number,
            "node": node,
            "width_um": width_um,
            "target": target,
        }
        for node, width_um, target in squeezes
    ]
    end = {
        "kind": "outcome",
        "part": number,
        "outcome": outcome,
        "leaf": leaf,
        "reason": reason,
        "audit": None,
    }
    return [{"kind": "part", "part": number}, *steps, end]
