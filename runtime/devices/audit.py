"""Runs the auditor, a separate program that judges the pose of each located part.

Question and answer are one JSON line each:

```
-> {"part": 3, "x_mm": 0.0, "y_mm": 0.5, "theta_rad": 0.0}
<- {"verdict": "pass", "residual_x_mm": 0.02, ...}
```

Before a run, a question without a pose, `{"part": 0}`, tests the program: if the program ends, or answers
without a verdict, the run is refused. Every question also states `table_sha256`, the digest of the run's
table. An auditor that judges by a table states the digest of its table in the first answer; if the digests
differ, the run is refused.

During the run the auditor never stops the cell: if it fails, or does not answer within the deadline, the
verdict is "unknown". With several hypotheses, the question also states the `hypothesis` that the leaf names.
"""

import json
import shlex
from collections.abc import Mapping
from contextlib import suppress

from runtime.devices.child import ChildProcess
from runtime.devices.clock import SystemClock
from runtime.shell import strict_json
from runtime.shell.command import one_line
from runtime.shell.errors import UsageError
from runtime.shell.plain_text import is_plain
from runtime.table import Pose2

REFUTED = "fail"
VERDICTS = ("pass", REFUTED)
UNKNOWN = "unknown"
ANSWER_S = 10.0
START_S = 60.0  # time to load OpenCV, perhaps on a busy machine
MAX_TEXT = 500


class AuditProcess(ChildProcess):
    """An auditor that was started as a child process.

    Args:
        command: the command line that starts the auditor.
        table_sha256: digest of the run's table; None: not compared.

    Raises:
        UsageError: the program cannot be started.
    """

    def __init__(self, command: str, table_sha256: str | None = None) -> None:
        self._command = command
        self._common = {} if table_sha256 is None else {"table_sha256": table_sha256}
        self._answer_s = ANSWER_S  # time limit for judging one part
        self._owed = 0  # number of questions without an answer so far, given up or not
        if not command.strip():
            raise UsageError(f"--audit {command!r} cannot be started: it names no program")
        try:
            super().__init__(shlex.split(command))
        except (OSError, ValueError) as error:
            raise UsageError(f"--audit {command!r} cannot be started: {error}") from error

    def judge(self, part: int, pose: Pose2, hypothesis: str | None = None) -> dict[str, object]:
        """Asks for the verdict on a part at a pose (mm, mm, rad); `hypothesis` names one of several parts.

        Returns:
            The fields of the answer that are numbers or short texts. Its `verdict` is "pass", "fail" or,
            where the auditor fails or its answer is invalid, "unknown".
        """
        asked = {"part": part, **dict(zip(("x_mm", "y_mm", "theta_rad"), pose, strict=True))}
        named = {} if hypothesis is None else {"hypothesis": hypothesis}
        try:
            record = self._ask({**asked, **named}, self._answer_s)
        except Exception as error:
            return {"verdict": UNKNOWN, "reason": one_line(error)[:MAX_TEXT]}
        verdict = record.get("verdict")
        fields = record.items()
        plain = {name: value for name, value in fields if name.isidentifier() and _is_plain(value)}
        return {**plain, "verdict": verdict if verdict in VERDICTS else UNKNOWN}

    def check(self) -> None:
        """Tests the auditor before a run, with a question without a pose; any verdict is a valid answer.

        Raises:
            UsageError: the program has ended, does not answer, answers without a verdict, or judges by
                another table.
        """
        try:
            reply = self._ask({"part": 0}, START_S)
        except ValueError:
            reply = {}
        except OSError as error:
            raise UsageError(f"--audit {self._command!r}: {error}") from error
        if "verdict" not in reply:
            raise UsageError(
                f"--audit {self._command!r} answers without a verdict; it must answer each JSON line with one"
            )
        stated, run = reply.get("table_sha256"), self._common.get("table_sha256")
        if run is not None and stated not in (None, run):
            raise UsageError(
                f"--audit judges by another table, with the SHA-256 {str(stated)[:16]}, than the one that is "
                f"run, {run[:16]}; name the same --tree to both"
            )

    def _ask(self, asked: Mapping[str, object], answer_s: float) -> Mapping[str, object]:
        try:
            until = SystemClock().now() + answer_s
            if not self._owed and self._drop_unread(until):
                raise ValueError("the auditor answered a question more than once")
            self._owed += 1
            self._tell(json.dumps({**asked, **self._common}).encode(), until)
            answer = b""
            while self._owed:
                answer = self._line(until)
                self._owed -= 1
        except (BrokenPipeError, EOFError) as error:
            raise ConnectionError(
                "the auditor has ended, or talks without end; run its command by itself to see why"
            ) from error
        except TimeoutError as error:
            raise TimeoutError(f"the auditor did not answer within {answer_s:g} s") from error
        reply = strict_json.parse(answer)
        return reply if isinstance(reply, dict) else {}

    def _drop_unread(self, until: float) -> bool:
        """Drops the lines that nobody asked for, until a time at most; returns whether there were any."""
        dropped = False
        with suppress(TimeoutError):
            while SystemClock().now() < until:
                self._line(0.0)
                dropped = True
        return dropped


def _is_plain(value: object) -> bool:
    if isinstance(value, str):
        return is_plain(value, MAX_TEXT)
    return value is None or isinstance(value, int | float)
