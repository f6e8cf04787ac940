"""Journals of audited parts, written line by line, without a sync for each of them."""

import base64
import hashlib
import json

from histories import table

from runtime.table import dumps

TABLE = table()
STAMP = "2026-01-02T03:04:05.000Z"
NAMES = ("residual_x_mm", "residual_y_mm", "residual_theta_rad")


class Chain:
    """Writes a journal's lines, each with the digest of the one before, without a sync for each of them."""

    def __init__(self, path):
        self._path = path
        self._lines = path.read_text().splitlines() if path.exists() else []

    def header(self, tree):
        data = dumps(tree)
        digest = hashlib.sha256(data).hexdigest()
        embedded = base64.b64encode(data).decode()
        self.record(
            "header", {"journal_version": 1, "table_sha256": digest, "table_base64": embedded}
        )

    def record(self, kind, fields):
        previous = json.loads(self._lines[-1])["digest"] if self._lines else "0" * 64
        frame = {
            "seq": len(self._lines),
            "time": STAMP,
            "kind": kind,
            **fields,
            "previous": previous,
        }
        body = json.dumps(frame, separators=(",", ":"))
        self._lines.append(f'{body[:-1]},"digest":"{hashlib.sha256(body.encode()).hexdigest()}"}}')

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._path.write_text("".join(line + "\n" for line in self._lines))


def write(path, parts, tree=TABLE, ended=True):
    """A journal as grasp-runtime writes one, with the audit's measurements in it."""
    with Chain(path) as journal:
        journal.header(tree)
        for part in parts:
            journal.record("part", {"part": part.number})
            for number, squeeze in enumerate(part.squeezes):
                branches = tree.nodes[squeeze.node].branches
                target = None if squeeze.branch is None else branches[squeeze.branch].target
                journal.record(
                    "squeeze",
                    {
                        "part": part.number,
                        "number": number + 1,
                        "node": squeeze.node,
                        "width_um": squeeze.width_um,
                        "target": target,
                    },
                )
            if part.verdict is not None:
                measured = (
                    {} if part.residual is None else dict(zip(NAMES, part.residual, strict=True))
                )
                journal.record("audit", {"part": part.number, "verdict": part.verdict, **measured})
            journal.record(
                "outcome",
                {
                    "part": part.number,
                    "outcome": part.outcome,
                    "leaf": part.leaf,
                    "audit": part.verdict,
                },
            )
        if ended:
            journal.record("end", {"exit_code": 0})
    return path
