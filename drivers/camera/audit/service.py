"""The audit as a process that answers questions: one JSON line in, one out, each within a deadline.

The lines are those of `runtime.devices.audit`, with more fields of the measurement. A question is always
answered: by "unknown" where the camera hangs, memory runs out or anything else fails. A process that has
grown too large restarts between two questions.
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
# Of address space: thread stacks and allocators' pools, most of it never touched.
RESERVE_BYTES = 1 << 30
PAGE_BYTES = resource.getpagesize()
MISUNDERSTOOD = "the question is not understood; it takes part, x_mm, y_mm and theta_rad"


class Worker:
    """A thread that judges one part after the other, so that one that hangs cannot delay an answer."""

    def __init__(self, make: Callable[[], Auditor]) -> None:
        self.asked = False
        self.why_not: Exception | None = None  # why there is no auditor
        self._make = make
        self._questions: queue.Queue[tuple[int, Pose2, float, str | None]] = queue.Queue()
        self._answers: queue.Queue[Answer] = queue.Queue()
        self._owed = 0
        threading.Thread(target=self._work, name="audit", daemon=True).start()

    def ask(
        self, part: int, predicted: Pose2, deadline_s: float, name: str | None = None
    ) -> Answer:
        """Judges one part within a deadline."""
        self.asked = True
        start = time.monotonic()
        while self._owed:
            if self._next_answer(start + 0.5 * deadline_s) is None:
                return Answer(UNKNOWN, "the camera still hangs; restart grasp-audit")
        self._questions.put((part, predicted, start + PICTURE_SHARE * deadline_s, name))
        self._owed += 1
        return self._next_answer(start + deadline_s) or Answer(
            UNKNOWN, f"the part was not judged within {deadline_s:g} s; check the camera"
        )

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
    """Lines of a pipe, read without Python's buffer, so that it is known when none is pending."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._read = b""

    @property
    def waiting(self) -> bool:
        """Whether data has come that was not returned yet."""
        return bool(self._read) or bool(select.select([self._descriptor], [], [], 0.0)[0])

    def next(self) -> bytes | None:
        """The next line; None at the end."""
        while b"\n" not in self._read:
            piece = os.read(self._descriptor, 4096)
            if not piece or len(self._read) > MAX_LINE_BYTES:
                return None
            self._read += piece
        line, _, self._read = self._read.partition(b"\n")
        return line


def serve(
    lines: Lines,
    worker: Worker,
    write: Callable[[bytes], object],
    deadline_s: float,
    full: Callable[[], bool],
    table_sha256: str | None = None,
) -> bool:
    """Answers questions until there are no more.

    Args:
        lines: the questions.
        worker: judges.
        write: writes an answer's line.
        deadline_s: for each.
        full: whether the process has grown too large.
        table_sha256: digest of the auditor's table, None: unknown.

    Returns:
        Whether it ended in order to restart.
    """
    while (line := lines.next()) is not None:
        answer = _answered(line, worker, deadline_s, table_sha256)
        try:
            write(json.dumps(answer).encode("ascii") + b"\n")
        except BrokenPipeError:  # the client has gone
            return False
        if full() and not lines.waiting:
            return True
    return False


def limit_memory(memory_mb: float) -> Callable[[], bool]:
    """Limits this process's memory growth; returns whether the limit is reached.

    Address space is limited as well, `RESERVE_BYTES` above that.
    """
    virtual, resident = _memory()
    extra = int(memory_mb * (1 << 20))
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = virtual + extra + RESERVE_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))
    return lambda: _memory()[1] > resident + extra


def _answered(
    line: bytes, worker: Worker, deadline_s: float, table_sha256: str | None
) -> dict[str, object]:
    """The answer to a line; for another table, or without a pose, it names the auditor's table."""
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
    return worker.ask(part, predicted, deadline_s, name).fields()


def _memory() -> tuple[int, int]:
    """Address space and resident memory, bytes."""
    virtual, resident = Path("/proc/self/statm").read_text().split()[:2]
    return int(virtual) * PAGE_BYTES, int(resident) * PAGE_BYTES
