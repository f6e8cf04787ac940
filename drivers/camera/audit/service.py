"""The audit as a process: answers each question, a line of JSON, by a line of JSON before a deadline.

The lines have the format of `runtime.devices.audit`; an answer also states what the camera measured, if it
did. Every question is answered: if the camera hangs, memory runs out or anything else fails, the verdict is
"unknown". A process that has grown too large restarts between two questions.
"""

import json
import os
import queue
import resource
import select
import threading
import time
from collections.abc import Callable
from pathlib import Path

from drivers.camera.audit.auditor import UNKNOWN, Answer, Auditor
from drivers.planar import Pose2
from runtime.shell import strict_json
from runtime.shell.errors import ExpectedError

MAX_LINE_BYTES = 65_536
PICTURE_SHARE = 0.7  # share of the deadline for taking a picture, the rest is for measuring
# Address space allowed for thread stacks and allocators' pools; most of it is never touched.
RESERVE_BYTES = 1 << 30
PAGE_BYTES = resource.getpagesize()
MISUNDERSTOOD = "the question is not understood; it takes part, x_mm, y_mm and theta_rad"


class Worker:
    """Judges one part after the other in a separate thread, so that a hanging camera cannot delay answers.

    Args:
        make: creates the auditor.
        deadline_s: time limit for each answer.
    """

    def __init__(self, make: Callable[[], Auditor], deadline_s: float) -> None:
        self.deadline_s = deadline_s
        self.asked = False  # whether there was a question about a part
        # why the auditor could not be created; None: no error
        self.why_not: Exception | None = None
        self._make = make
        self._questions: queue.Queue[tuple[int, Pose2, float, str | None]] = queue.Queue()
        self._answers: queue.Queue[Answer] = queue.Queue()
        self._owed = 0  # number of questions without an answer
        threading.Thread(target=self._work, name="audit", daemon=True).start()

    def ask(self, part: int, predicted: Pose2, name: str | None = None) -> Answer:
        """Judges one part; the verdict is "unknown" if there is no answer within `deadline_s`."""
        self.asked = True
        start, deadline_s = time.monotonic(), self.deadline_s
        while self._owed:
            if self._next_answer(start + 0.5 * deadline_s) is None:
                return Answer(UNKNOWN, "the camera still hangs; restart grasp-audit")
        self._questions.put((part, predicted, start + PICTURE_SHARE * deadline_s, name))
        self._owed += 1
        late = f"the part was not judged within {deadline_s:g} s; check the camera"
        return self._next_answer(start + deadline_s) or Answer(UNKNOWN, late)

    def _next_answer(self, until: float) -> Answer | None:
        try:
            answer = self._answers.get(timeout=max(until - time.monotonic(), 0.0))
        except queue.Empty:
            return None
        self._owed -= 1
        return answer

    def _work(self) -> None:
        audits: Auditor | None = None
        while True:
            question = self._questions.get()
            try:
                audits = audits or self._make()
                self.why_not = None
                answer = audits.audit(*question)
            except Exception as error:
                self.why_not = error if audits is None else None
                said = " ".join(str(error).split())
                if isinstance(error, MemoryError):
                    said = "the audit's memory is used up; raise --memory-mb"
                elif not isinstance(error, ExpectedError):
                    said = f"{said} ({type(error).__name__})"
                answer = Answer(UNKNOWN, said)
            self._answers.put(answer)


class Lines:
    """Reads lines of a pipe without Python's buffer, so that `waiting` misses no data."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._read = b""

    @property
    def waiting(self) -> bool:
        """Whether there is data that `next` has not returned yet, or the pipe has ended."""
        return bool(self._read) or bool(select.select([self._descriptor], [], [], 0.0)[0])

    def next(self) -> bytes | None:
        """Waits for the next line and returns it; None at the end of the pipe.

        A line longer than `MAX_LINE_BYTES` is returned in part: later bytes may be missing.
        """
        while b"\n" not in self._read:
            piece = os.read(self._descriptor, 4096)
            if not piece:
                return None
            self._read = self._read[:MAX_LINE_BYTES] + piece
        line, _, self._read = self._read.partition(b"\n")
        return line


def serve(
    lines: Lines,
    worker: Worker,
    write: Callable[[bytes], object],
    full: Callable[[], bool],
    table_sha256: str | None = None,
) -> bool:
    """Answers questions until there are no more, nobody reads the answers, or the process is too large.

    Args:
        lines: the questions.
        worker: judges the parts.
        write: writes the line of an answer.
        full: returns whether the process has grown too large.
        table_sha256: digest of the auditor's table; None: unknown.

    Returns:
        Whether the process has grown too large, and has to be restarted.
    """
    while (line := lines.next()) is not None:
        answer = _answered(line, worker, table_sha256)
        try:
            write(json.dumps(answer).encode("ascii") + b"\n")
        except BrokenPipeError:  # the client has gone
            return False
        if full() and not lines.waiting:
            return True
    return False


def limit_memory(memory_mb: float) -> Callable[[], bool]:
    """Limits the growth of this process's address space to `memory_mb` plus `RESERVE_BYTES`.

    Returns:
        A function that says whether resident memory has grown by more than `memory_mb`.
    """
    virtual, resident = _memory()
    extra = int(memory_mb * (1 << 20))
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = virtual + extra + RESERVE_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))
    return lambda: _memory()[1] > resident + extra


def _answered(line: bytes, worker: Worker, table_sha256: str | None) -> dict[str, object]:
    """Returns the fields of the answer to a line.

    A question may state the digest of the run's table. If the auditor has another table, nothing is judged.
    A question with a digest but no pose only asks whether the tables agree. In both cases the answer holds
    the digest of the auditor's table.
    """
    try:
        asked = strict_json.parse(line)
        run = asked.get("table_sha256")
    except (AttributeError, ValueError):
        return Answer(UNKNOWN, MISUNDERSTOOD).fields()
    if table_sha256 and run is not None and (run != table_sha256 or "x_mm" not in asked):
        others = f"the auditor judges by another table, {table_sha256[:16]}; name the same --tree to both"
        reason = "ready" if run == table_sha256 else others
        return {**Answer(UNKNOWN, reason).fields(), "table_sha256": table_sha256}
    try:
        part = int(asked["part"])
        name = None if asked.get("hypothesis") is None else str(asked["hypothesis"])
        predicted = (float(asked["x_mm"]), float(asked["y_mm"]), float(asked["theta_rad"]))
    except (ValueError, TypeError, KeyError, OverflowError):
        return Answer(UNKNOWN, MISUNDERSTOOD).fields()
    return worker.ask(part, predicted, name).fields()


def _memory() -> tuple[int, int]:
    """Address space and resident memory, bytes."""
    virtual, resident = Path("/proc/self/statm").read_text().split()[:2]
    return int(virtual) * PAGE_BYTES, int(resident) * PAGE_BYTES
