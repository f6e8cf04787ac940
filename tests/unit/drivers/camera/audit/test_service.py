"""The audit's answers to lines that come down a pipe."""

import json
import os
import threading

import pytest

from drivers.camera.audit.auditor import PASS, UNKNOWN, Answer
from drivers.camera.audit.service import MAX_LINE_BYTES, MISUNDERSTOOD, Lines, Worker, serve

QUESTION = b'{"part": 1, "x_mm": 0.0, "y_mm": 0.0, "theta_rad": 0.0}'


class Passing:
    """An auditor whose verdict on each part is "pass"."""

    def audit(self, part, predicted, until, name):
        return Answer(PASS, "as predicted")


def answers(asked: bytes) -> list[dict[str, object]]:
    """Writes the lines `asked` into a pipe and closes it; returns the audit's answers to them."""
    reading, writing = os.pipe()

    def ask():
        with os.fdopen(writing, "wb") as pipe:
            pipe.write(asked)

    asking = threading.Thread(target=ask)
    asking.start()
    written = list[bytes]()
    serve(Lines(reading), Worker(Passing, 10.0), written.append, lambda: False)
    os.close(reading)
    asking.join()
    return [json.loads(line) for line in written]


@pytest.mark.parametrize(
    "line",
    [b"x" * (MAX_LINE_BYTES - 1), b"x" * (MAX_LINE_BYTES + 1), b"x" * (5 * MAX_LINE_BYTES)],
    ids=["shorter than the limit", "longer", "several times as long"],
)
def test_serve_invalid_line_is_answered_unknown_and_next_is_judged(line):
    said, judged = answers(line + b"\n" + QUESTION + b"\n")
    assert (said["verdict"], said["reason"]) == (UNKNOWN, MISUNDERSTOOD)
    assert judged["verdict"] == PASS
