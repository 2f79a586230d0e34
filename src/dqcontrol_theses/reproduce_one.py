"""Reproductions: published experiments run again, their tables beside the printed ones, verdicts on the claims."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from dqcontrol.errors import ValueRangeError, unknown_name
from dqcontrol.experiments import SPEC_FILE
from dqcontrol_theses.catalogue import (
    SAMPLES,
    Conditions,
    Progress,
    chosen_plant,
    experiments,
    names,
    source,
)
from dqcontrol_theses.reproduced import Reproduced


def reproduce(
    name: str,
    *,
    plant: str | None = None,
    jobs: int | None = None,
    samples: int = SAMPLES,
    repeats: int | None = None,
    progress: Progress | None = None,
    unfinished: str | Path | None = None,
) -> Reproduced:
    """Run a published experiment again and hold it against what was printed.

    Parameters
    ----------
    name
        As `catalogue_table` lists them, with or without the source's name.
    plant
        What stands for the source's robot, one of those listed; default: the first.
    jobs
        Processes that work in parallel; as for `run_study`.
    samples
        Of each run in real time.
    repeats
        At most so many of each run, at least 1; default: as many as were printed.
    progress
        Called with the name of what is run, how much of it is done, and how much it is in all.
    unfinished
        Working folder that keeps finished trials, searches and repeats, so that the same call resumes after an
        interruption; it stays there when all is done. Needs pyarrow.

    Raises
    ------
    UnknownNameError
        If there is no such experiment or plant.
    ValueRangeError
        If ``repeats`` is below 1.
    ExistsError
        If ``unfinished`` holds results of another experiment, number of repeats or version.

    Examples
    --------
    >>> from dqcontrol_theses import reproduce
    >>> done = reproduce("light-painting", plant="servo", jobs=1)
    >>> {study.rows[0]["stopped"] for study in done.studies.values()}
    {'duration'}
    """
    if repeats is not None and repeats < 1:
        raise ValueRangeError(f"repeats: must be at least 1, got {repeats}")
    full, *others = names(name)
    if others:
        raise unknown_name("reproduction", name, list(experiments()))
    folder, _, short = full.partition("/")
    kept = None if unfinished is None else Path(unfinished)
    conditions = Conditions(chosen_plant(full, plant), jobs, samples, repeats, progress, kept)
    return replace(source(folder).reproduce(short, conditions), conditions=_chosen(samples, repeats))


def is_finished(
    folder: str | Path,
    name: str,
    *,
    plant: str | None = None,
    samples: int = SAMPLES,
    repeats: int | None = None,
) -> bool:
    """Tell whether a folder holds the results that `reproduce` would give again: such folders are written whole.

    Parameters
    ----------
    folder
        Where `Reproduced.save` would write.
    name, plant, samples, repeats
        As for `reproduce`, the name with its source.
    """
    file = Path(folder) / SPEC_FILE
    same = Reproduced(name, [], plant=chosen_plant(name, plant), conditions=_chosen(samples, repeats))
    return file.is_file() and file.read_text(encoding="utf-8") == same.heading


def _chosen(samples: int, repeats: int | None) -> dict[str, int]:
    """Return the options that are not at their defaults."""
    chosen = {} if repeats is None else {"repeats": repeats}
    return chosen | ({} if samples == SAMPLES else {"samples": samples})
