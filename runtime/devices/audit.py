"""The auditor as a process of its own: one JSON line asked, one answered, within a deadline, or "unknown".

```
-> {"part": 3, "x_mm": 0.0, "y_mm": 0.5, "theta_rad": 0.0}
<- {"verdict": "pass", "residual_x_mm": 0.02, ...}
```

Before a run, `{"part": 0}` asks for no more than a verdict: a program that is not there, ends or says
something else is refused then. A camera never stops the cell: whatever is wrong with it, the verdict is
"unknown" and the run goes on.
"""

import contextlib
import json
import os
import select
import shlex
import subprocess
from collections.abc import Mapping
from math import isfinite
from types import TracebackType
from typing import Self

from runtime.devices.ports import Auditor, Clock
from runtime.errors import ArgumentsError
from runtime.shell import strict_json
from runtime.table import Pose2

VERDICTS = ("pass", "fail")
UNKNOWN = "unknown"
ANSWER_S = 10.0
START_S = 60.0  # OpenCV is loaded meanwhile, perhaps on a busy machine
END_S = 2.0
MAX_ANSWER_BYTES = 65_536
MAX_TEXT = 500


def answer_of(auditor: Auditor, part: int, pose: Pose2) -> dict[str, object]:
    """The auditor's answer as the journal holds it: "unknown" where it fails or says anything else.

    Returns:
        `verdict`, and whatever else it told in plain numbers and short sentences: what it measured, and why.
    """
    try:
        told = dict(auditor.judge(part, *pose))
    except Exception as error:
        return {"verdict": UNKNOWN, "reason": " ".join(str(error).split())[:MAX_TEXT]}
    plain = {name: value for name, value in told.items() if name.isidentifier() and _is_plain(value)}
    return {**plain, "verdict": told.get("verdict") if told.get("verdict") in VERDICTS else UNKNOWN}


def _is_plain(value: object) -> bool:
    if isinstance(value, str):
        return len(value) <= MAX_TEXT
    return value is None or isinstance(value, bool | int) or (isinstance(value, float) and isfinite(value))


class AuditProcess:
    """An auditor started as a child, asked over its standard input and output.

    Args:
        command: the program and its arguments, as a shell would split them.
        clock: of the deadline.
        answer_s: seconds it may take to judge one part.

    Raises:
        ArgumentsError: the program cannot be started.
    """

    def __init__(self, command: str, clock: Clock, answer_s: float = ANSWER_S) -> None:
        self._command = command
        self._clock = clock
        self._answer_s = answer_s
        self._owed = 0  # answers still to come from questions that were not waited for
        self._read = b""
        try:
            self._process = subprocess.Popen(
                shlex.split(command), stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
        except (OSError, ValueError, IndexError) as error:
            raise ArgumentsError(f"--audit {command!r} cannot be started: {error}") from error

    def judge(self, part: int, x_mm: float, y_mm: float, theta_rad: float) -> Mapping[str, object]:
        """Ask for one part's verdict.

        Raises:
            OSError: the process is gone.
            TimeoutError: no answer in time.
            ValueError: an answer that is no JSON.
        """
        asked = {"part": part, "x_mm": x_mm, "y_mm": y_mm, "theta_rad": theta_rad}
        return self._ask(asked, self._answer_s)

    def check(self) -> None:
        """Ask a question without a pose, which any verdict answers.

        Raises:
            ArgumentsError: the program has ended, is silent, or answers something else.
        """
        try:
            told = self._ask({"part": 0}, START_S)
        except ValueError:
            told = {}
        except OSError as error:
            raise ArgumentsError(f"--audit {self._command!r}: {error}") from error
        if "verdict" not in told:
            raise ArgumentsError(
                f"--audit {self._command!r} answers without a verdict; for a JSON line a part it gives one"
            )

    def _ask(self, asked: Mapping[str, object], answer_s: float) -> Mapping[str, object]:
        assert self._process.stdin is not None
        try:
            os.write(self._process.stdin.fileno(), json.dumps(asked).encode() + b"\n")
        except BrokenPipeError as error:
            raise ConnectionError("the auditor has ended; run its command by itself to see why") from error
        self._owed += 1
        until = self._clock.now() + answer_s
        answer = b""
        while self._owed:
            answer = self._line(until, answer_s)
            self._owed -= 1
        told = strict_json.parse(answer)
        return told if isinstance(told, dict) else {}

    def close(self) -> None:
        """End the process; one that does not react is killed."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _line(self, until: float, answer_s: float) -> bytes:
        assert self._process.stdout is not None
        pipe = self._process.stdout.fileno()
        while b"\n" not in self._read:
            left = until - self._clock.now()
            if not select.select([pipe], [], [], max(left, 0.0))[0]:
                raise TimeoutError(f"the auditor did not answer within {answer_s:g} s")
            piece = os.read(pipe, 4096)
            if not piece or len(self._read) > MAX_ANSWER_BYTES:
                raise ConnectionError(
                    "the auditor has ended, or talks without end; run its command by itself to see why"
                )
            self._read += piece
        line, _, self._read = self._read.partition(b"\n")
        return line
