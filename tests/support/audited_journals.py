"""Writes journals of audited parts without the runtime, which would sync every record to disk."""

import json

from histories import table
from run_logs import chained
from run_logs import header as header_of

from runtime.table import dumps

TABLE = table()
NAMES = ("residual_x_mm", "residual_y_mm", "residual_theta_rad")


class Chain:
    """Appends records to the journal at `path`; the file need not exist.

    The records are written, and chained by new digests, at the end of the `with`.
    """

    def __init__(self, path):
        self._path = path
        lines = path.read_bytes().splitlines() if path.exists() else []
        self._entries = [json.loads(line) for line in lines]

    def header(self, tree):
        run = {"journal_version": 1, "run": str(self._path)}  # two runs never have the same header
        self._entries.append({**header_of(dumps(tree)), **run})

    def record(self, kind, fields):
        self._entries.append({"kind": kind, **fields})

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._path.write_bytes(chained(self._entries))


def write(path, parts, tree=TABLE, ended=True):
    """Appends a run of `parts` to a journal, as grasp-runtime would record it; returns the path.

    The records of the audit contain the parts' residuals. If `ended` is false, the run has no last record.
    """
    with Chain(path) as journal:
        journal.header(tree)
        for part in parts:
            journal.record("part", {"part": part.number})
            for number, (node, branch, width_um) in enumerate(part.squeezes, 1):
                target = None if branch is None else tree.nodes[node].branches[branch].target
                read = {"number": number, "node": node, "width_um": width_um, "target": target}
                journal.record("squeeze", {"part": part.number, **read})
            if part.verdict is not None:
                measured = dict(zip(NAMES, part.residual or (), strict=False))
                journal.record("audit", {"part": part.number, "verdict": part.verdict, **measured})
            end = {"outcome": part.outcome, "leaf": part.leaf, "audit": part.verdict}
            journal.record("outcome", {"part": part.number, **end})
        if ended:
            journal.record("end", {"exit_code": 0})
    return path
