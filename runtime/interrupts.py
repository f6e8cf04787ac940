"""Ctrl-C and SIGTERM as one stop request that is heard once, so that nothing interrupts the safe sequence."""

import contextlib
import os
import signal
from types import FrameType, TracebackType
from typing import Self

STDERR = 2
SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopRequests:
    """While entered, the first of `SIGNALS` raises KeyboardInterrupt, a later one is only acknowledged."""

    def __init__(self) -> None:
        self._asked = False
        self._before: dict[signal.Signals, signal._HANDLER] = {}

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._hear) for number in SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        if self._asked:
            with contextlib.suppress(OSError):  # whoever read it may be gone
                os.write(STDERR, b"stopping already\n")
            return
        self._asked = True
        raise KeyboardInterrupt
