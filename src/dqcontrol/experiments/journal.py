"""The journal of a study that runs: the rows of its finished trials."""

from __future__ import annotations

import time
from pathlib import Path

from dqcontrol.errors import FileFormatError
from dqcontrol.experiments.prepared_experiment import PreparedExperiment
from dqcontrol.experiments.row_file import Row, read_rows, write_rows
from dqcontrol.experiments.trials import Trial, TrialOutcome
from dqcontrol.experiments.working_folder import WorkingFolder

_EVERY = 2.0  # s between parts


class Journal(WorkingFolder):
    """A working folder with the rows of a study's finished trials, in the order that they finish.

    Parameters
    ----------
    folder, force
        As for `WorkingFolder`, which says what is raised, too.
    setting
        The study.
    """

    def __init__(self, folder: Path, setting: PreparedExperiment, *, force: bool = False) -> None:
        self._pending: list[Row] = []
        self._written = time.monotonic()
        super().__init__(folder, setting.text, setting.fingerprint(), force=force)
        self._next = max(self.parts(), default=-1) + 1

    def finished(self) -> dict[Trial, Row]:
        """Return the rows of all finished trials.

        Raises
        ------
        FileFormatError
            If a part is damaged.
        """
        rows: dict[Trial, Row] = {}
        for path in self.parts().values():
            try:
                rows |= {Trial.of(row): row for row in read_rows(path)}
            except (FileFormatError, KeyError) as error:
                raise FileFormatError(
                    f"{path}: is damaged ({error}); remove it to repeat its trials"
                ) from None
        return rows

    def add(self, outcome: TrialOutcome) -> None:
        """Note a finished trial; it reaches the disk within two seconds, or when the journal is closed."""
        self._pending.append(outcome.row)
        if time.monotonic() - self._written > _EVERY:
            self._flush()

    def _flush(self) -> None:
        if self._pending:
            write_rows(self.part(self._next), self._pending, {})
            self._pending, self._next = [], self._next + 1
        self._written = time.monotonic()

    def close(self) -> None:
        """Write what is noted, and let others in."""
        try:
            self._flush()
        finally:
            super().close()

    def discard(self) -> None:
        """Remove the folder."""
        self._pending = []
        super().discard()
