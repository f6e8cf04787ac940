"""What the drivers tell of their links, retries above all: kept until there is a journal to write it to."""

from collections.abc import Callable, Mapping

from runtime.devices.ports import Journal

Report = Callable[[str, Mapping[str, object]], None]

MOST_KEPT = 1000  # of a link so bad that connecting takes more, the first ones tell enough


class Incidents:
    """A report that begins before the journal does: a run that never was leaves no file."""

    def __init__(self) -> None:
        self._journal: Journal | None = None
        self._kept: list[tuple[str, Mapping[str, object]]] = []

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        """Write one incident, or keep it.

        Raises:
            JournalError: it cannot be written.
        """
        if self._journal is not None:
            self._journal.record(kind, fields)
        elif len(self._kept) < MOST_KEPT:
            self._kept.append((kind, fields))

    def hand_over(self, journal: Journal) -> None:
        """Write what was kept; from now on write at once.

        Raises:
            JournalError: it cannot be written.
        """
        self._journal = journal
        for kind, fields in self._kept:
            journal.record(kind, fields)
        self._kept.clear()
