"""Published experiments that can be reproduced: those of each source, which is a package beside this file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

from dqcontrol.errors import unknown_name
from dqcontrol.tables import Column, Table

if TYPE_CHECKING:
    from dqcontrol.experiments import Study
    from dqcontrol_theses.reproduced import Reproduced

P = TypeVar("P")
R = TypeVar("R")
SOURCES = ("pereira2016", "silva2017")
SAMPLES = 500  # of each run in real time

Progress = Callable[[str, float, int], None]  # what is run, how much of it is done, and how much it is in all


@dataclass(frozen=True)
class Experiment:
    """One published experiment.

    Attributes
    ----------
    about
        What it is, and its tables in the source.
    plants
        What can stand for the source's robot, the default first; empty where there is no choice.
    """

    about: str
    plants: tuple[str, ...] = ()


@dataclass(frozen=True)
class Conditions:
    """How an experiment is run again.

    Attributes
    ----------
    plant
        One of the experiment's; empty where there is no choice.
    jobs
        Processes that work in parallel; as for `run_study`.
    samples
        Of each run in real time.
    repeats
        At most so many of each run; None: as many as were printed.
    progress
        Called with the name of what is run, how much of it is done, and how much it is in all.
    unfinished
        Folder that keeps finished trials, searches and repeats, so that the same call resumes after an interruption;
        None: they are lost with the process.
    """

    plant: str = ""
    jobs: int | None = None
    samples: int = SAMPLES
    repeats: int | None = None
    progress: Progress | None = None
    unfinished: Path | None = None

    def of(self, label: str) -> Callable[[float, int], None] | None:
        """Return the progress of one study."""
        report = self.progress
        return None if report is None else lambda done, total: report(label, done, total)

    def run_study(self, label: str, source: dict[str, Any]) -> Study:
        """Run one study of an experiment; it resumes with the trials that are left."""
        from dqcontrol.experiments import run_study

        return run_study(source, jobs=self.jobs, progress=self.of(label), journal=self.journal(label))

    def each(
        self, label: str, function: Callable[[P], R], kind: type[R], parts: Sequence[P], spec: str
    ) -> list[R]:
        """Return what a function gives for each part of an experiment; see `work_through`."""
        from dqcontrol.experiments import work_through

        return work_through(function, kind, parts, spec, self.jobs, self.of(label), self.journal(label))

    def journal(self, label: str) -> Path | None:
        """Return the folder that keeps what is finished of one part of an experiment; None if nothing is kept."""
        return self.unfinished / label if self.unfinished else None


class Publication(Protocol):
    """What the package of a source offers."""

    EXPERIMENTS: Mapping[str, Experiment]

    def reproduce(self, name: str, conditions: Conditions) -> Reproduced:
        """Run one of the experiments again."""
        ...


def source(name: str) -> Publication:
    """Return the package of one of `SOURCES`."""
    return cast(Publication, import_module(f"{__package__}.{name}"))


def experiments() -> dict[str, Experiment]:
    """Return all experiments by name, with their sources', as ``"pereira2016/spiral"``."""
    return {
        f"{folder}/{name}": experiment
        for folder in SOURCES
        for name, experiment in source(folder).EXPERIMENTS.items()
    }


def names(name: str) -> list[str]:
    """Return the experiments that a name stands for: one, with or without its source's name, or all of a source.

    Raises
    ------
    UnknownNameError
        If no experiment has that name.

    Examples
    --------
    >>> import dqcontrol_theses as published
    >>> published.names("spiral")
    ['pereira2016/spiral']
    """
    known = experiments()
    if name in known:
        return [name]
    found = [each for each in known if name in each.split("/")]
    if not found or (name not in SOURCES and len(found) > 1):
        raise unknown_name("reproduction", name, list(known))
    return found


def chosen_plant(name: str, plant: str | None) -> str:
    """Return what stands for the robot of an experiment (full name): what is asked for, or the default.

    Raises
    ------
    UnknownNameError
        If it cannot.
    """
    plants = experiments()[name].plants
    if plant is None:
        return plants[0] if plants else ""
    if plant not in plants:
        raise unknown_name("plant", plant, plants)
    return plant


def catalogue_table() -> Table:
    """Return one row an experiment."""
    rows = [[name, each.about, ", ".join(each.plants)] for name, each in experiments().items()]
    return Table([Column("name"), Column("experiment"), Column("plants, default first")], rows)
