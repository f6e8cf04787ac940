"""The auditor as a separate process: one JSON line in, one out, within a deadline, or "unknown".

```
-> {"part": 3, "x_mm": 0.0, "y_mm": 0.5, "theta_rad": 0.0}
<- {"verdict": "pass", "residual_x_mm": 0.02, ...}
```

Before a run, `{"part": 0}` asks for a verdict only: a program that is missing, ends or answers otherwise is
refused then. Every question holds `table_sha256`, the digest of the run's table; an auditor that judges by
a table answers the first question with the digest of that table, and the run is refused where the two
differ. A camera never stops the cell: if it fails, the verdict is "unknown" and the run continues. With
several hypotheses, the question also holds the `hypothesis` that the leaf names.
"""

import json
import shlex
from collections.abc import Mapping
from math import isfinite

from runtime.devices.child import ChildProcess
from runtime.devices.clock import SystemClock
from runtime.shell import strict_json
from runtime.shell.command import one_line
from runtime.shell.errors import UsageError
from runtime.shell.plain_text import is_plain
from runtime.table import Pose2

VERDICTS = ("pass", "fail")
UNKNOWN = "unknown"
ANSWER_S = 10.0
START_S = 60.0  # time to load OpenCV, perhaps on a busy machine
MAX_TEXT = 500


class AuditProcess(ChildProcess):
    """An auditor started as a child.

    Args:
        command: starts it.
        answer_s: time limit for judging one part.
        table_sha256: digest of the run's table; None: not compared.

    Raises:
        UsageError: the program cannot be started.
    """

    def __init__(
        self, command: str, answer_s: float = ANSWER_S, table_sha256: str | None = None
    ) -> None:
        self._command = command
        self._common = {} if table_sha256 is None else {"table_sha256": table_sha256}
        self._answer_s = answer_s
        self._owed = 0  # outstanding answers to questions that were given up
        try:
            super().__init__(shlex.split(command))
        except (OSError, ValueError, IndexError) as error:
            raise UsageError(f"--audit {command!r} cannot be started: {error}") from error

    def judge(
        self, part: int, x_mm: float, y_mm: float, theta_rad: float, hypothesis: str | None = None
    ) -> Mapping[str, object]:
        """Asks for one part's verdict; `hypothesis` is the name in its leaf, if any.

        Raises:
            OSError: the process is gone, or does not answer in time. ValueError: the answer is not JSON.
        """
        asked: dict[str, object] = {
            "part": part,
            "x_mm": x_mm,
            "y_mm": y_mm,
            "theta_rad": theta_rad,
        }
        asked |= {} if hypothesis is None else {"hypothesis": hypothesis}
        return self._ask(asked, self._answer_s)

    def check(self) -> None:
        """Asks a question without a pose, which any verdict answers.

        Raises:
            UsageError: the program has ended, does not answer, answers otherwise, or judges by another table.
        """
        try:
            reply = self._ask({"part": 0}, START_S)
        except ValueError:
            reply = {}
        except OSError as error:
            raise UsageError(f"--audit {self._command!r}: {error}") from error
        if "verdict" not in reply:
            raise UsageError(
                f"--audit {self._command!r} answers without a verdict; for a JSON line a part it gives one"
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
            self._owed += 1
            self._tell(json.dumps({**asked, **self._common}).encode(), until)
            answer = b""
            while self._owed:
                answer = self._line(until)
                self._owed -= 1
        except BrokenPipeError as error:
            raise ConnectionError(
                "the auditor has ended; run its command by itself to see why"
            ) from error
        except EOFError as error:
            message = (
                "the auditor has ended, or talks without end; run its command by itself to see why"
            )
            raise ConnectionError(message) from error
        except TimeoutError as error:
            raise TimeoutError(f"the auditor did not answer within {answer_s:g} s") from error
        reply = strict_json.parse(answer)
        return reply if isinstance(reply, dict) else {}


def answer_of(
    auditor: AuditProcess, part: int, pose: Pose2, hypothesis: str | None = None
) -> dict[str, object]:
    """The auditor's answer in the form of the journal: "unknown" where it fails or is invalid.

    Returns:
        `verdict`, and its other fields that are plain numbers or short sentences.
    """
    try:
        record = dict(auditor.judge(part, *pose, hypothesis))
    except Exception as error:
        return {"verdict": UNKNOWN, "reason": one_line(error)[:MAX_TEXT]}
    plain = {
        name: value for name, value in record.items() if name.isidentifier() and _is_plain(value)
    }
    return {
        **plain,
        "verdict": record.get("verdict") if record.get("verdict") in VERDICTS else UNKNOWN,
    }


def _is_plain(value: object) -> bool:
    if isinstance(value, str):
        return is_plain(value, MAX_TEXT)
    return (
        value is None
        or isinstance(value, bool | int)
        or (isinstance(value, float) and isfinite(value))
    )
