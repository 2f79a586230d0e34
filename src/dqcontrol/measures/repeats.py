"""The rows of a study in groups of repeats.

A row is one run: a mapping of the labels ``robot``, ``law``, ``set`` and ``plant``, perhaps ``parameter.X`` and
``study``, of ``seed``, ``stopped`` and of all numbers of `Metrics.flat`. Runs of the same labels are repeats of each
other.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import Any

from dqcontrol.errors import ShapeError, unknown_name
from dqcontrol.loop.record import has_failed
from dqcontrol.measures.statistics import Mean, mean_of
from dqcontrol.tables.table_cells import known
from dqcontrol.tables.tables import Column

Row = Mapping[str, Any]
Group = tuple[str | float, ...]  # the labels of runs that are repeats of each other

LABELS = ("study", "robot", "law", "set", "plant")
_LAW, _SET = LABELS.index("law"), LABELS.index("set")
_PARAMETER = "parameter."


class Repeats:
    """The rows of a study in groups of repeats.

    Parameters
    ----------
    rows
        Of a study.

    Raises
    ------
    ShapeError
        If there are none.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        if not rows:
            raise ShapeError("rows: expected at least one run, got none")
        self.parameters: list[str] = list(
            dict.fromkeys(name for row in rows for name in row if name.startswith(_PARAMETER))
        )
        self.names: tuple[str, ...] = (*LABELS, *self.parameters)
        self.groups: dict[Group, list[Row]] = {}
        for row in rows:
            self.groups.setdefault(tuple(_known(row.get(name)) for name in self.names), []).append(row)
        self._shown = [i for i in range(len(self.names)) if len({group[i] for group in self.groups}) > 1]
        without_set = {(*group[:_SET], *group[_SET + 1 :]) for group in self.groups}
        if _SET in self._shown and len(without_set) == len(self.groups) and self.parameters:
            self._shown.remove(_SET)  # its label repeats the parameters of a grid
        self._shown = self._shown or [_LAW]

    @property
    def columns(self) -> list[Column]:
        """Headings of the labels that differ."""
        return [
            Column(self.names[i].removeprefix(_PARAMETER) if i >= len(LABELS) else self.names[i].capitalize())
            for i in self._shown
        ]

    def label(self, group: Group, name: str) -> str | float:
        """Return one label of a group."""
        return group[self.names.index(name)]

    def labels(self, group: Group) -> list[str | float]:
        """Return the labels of a group that differ."""
        return [group[i] for i in self._shown]

    def describe(self, group: Group, names: Container[str]) -> str:
        """Return those of the named labels that differ, as ``"K · gain 5"``."""
        texts = []
        for i in self._shown:
            if self.names[i] in names and group[i] != "":
                value = group[i] if isinstance(group[i], str) else f"{group[i]:g}"
                texts.append(
                    f"{self.names[i].removeprefix(_PARAMETER)} {value}" if i >= len(LABELS) else value
                )
        return " · ".join(texts)

    def caption(self, title: str) -> str:
        """Return the title, with a note if runs are left out."""
        left_out = sum(map(self.failed, self.groups))
        note = f"{left_out} failed {'run' if left_out == 1 else 'runs'} left out" if left_out else ""
        return "; ".join(filter(None, (title, note)))

    def finished(self, group: Group) -> list[Row]:
        """Return the runs of a group that did not fail."""
        return [row for row in self.groups.get(group, ()) if not _failed(row)]

    def failed(self, group: Group) -> int:
        """Return how many runs of a group diverged or faulted."""
        return sum(map(_failed, self.groups[group]))

    def values(self, group: Group, key: str) -> list[float]:
        """Return a number of all runs of a group that did not fail, empty if one of them lacks it."""
        finished = self.finished(group)
        values = [value for row in finished if (value := known(row.get(key))) is not None]
        return values if len(values) == len(finished) else []

    def mean(self, group: Group, key: str) -> Mean | None:
        """Return mean and spread of a number, or None where there are none."""
        values = self.values(group, key)
        return mean_of(values) if values else None

    def by_seed(self, group: Group, key: str) -> dict[Any, float]:
        """Return a number of each run by its seed, without those that failed or lack it."""
        values: dict[Any, float] = {}
        for row in self.finished(group):
            if row["seed"] in values:
                raise ShapeError(f"rows: two runs of law '{row['law']}' have the seed {row['seed']}")
            if (value := known(row.get(key))) is not None:
                values[row["seed"]] = value
        return values

    def baseline(self, law: str | None) -> str:
        """Return the label of the law to compare with."""
        laws = list(dict.fromkeys(str(group[_LAW]) for group in self.groups))
        if law is not None and law not in laws:
            raise unknown_name("baseline", law, laws)
        return laws[0] if law is None else law

    def beside(self, group: Group, law: str) -> Group:
        """Return the group of another law with otherwise the same labels."""
        return (*group[:_LAW], law, *group[_LAW + 1 :])


def _known(label: str | float | None) -> str | float:
    """Return a label, empty for a parameter that a run does not have."""
    label = known(label)
    return "" if label is None else label


def _failed(row: Row) -> bool:
    return has_failed(str(row.get("stopped", "")))
