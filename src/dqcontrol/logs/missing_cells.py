"""Cells of a table that are empty: joined linearly, held or left out, and counted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError

Missing = Literal["interpolate", "skip"]


def fill_missing(
    path: Path,
    time: Array,
    values: Array,
    names: Sequence[str],
    measured: int,
    missing: Missing,
    notes: list[str],
) -> tuple[Array, Array]:
    """Return time and values without NaN.

    Measured positions are joined linearly in between, and samples before the first or after the last number of a joint
    left out; or all samples with one missing are. Of what was commanded the last number holds.

    Parameters
    ----------
    path
        The file, for errors.
    time, values
        (N,) s and (N, columns).
    names
        Of the columns.
    measured
        How many of the columns are measured positions; the others were commanded.
    missing
        What to do with missing positions.
    notes
        Takes a line that counts what was done.

    Raises
    ------
    FileFormatError
        If a column has no number at all, or no sample is left.
    """
    empty = np.isnan(values)
    if not empty.any():
        return time, values
    for i in np.flatnonzero(empty.all(axis=0))[:1]:
        raise FileFormatError(f"{path}: {names[i]}: all {len(time)} cells are empty")
    counts = [f"{names[i]} {count}" for i, count in enumerate(empty.sum(axis=0)) if count]
    values = values.copy()
    for i in range(measured, values.shape[1]):
        given = np.flatnonzero(~empty[:, i])
        last = np.searchsorted(given, np.arange(len(time)), side="right") - 1
        values[:, i] = values[given[np.maximum(last, 0)], i]
    if missing == "skip":
        kept = ~empty[:, :measured].any(axis=1)
        done = f"{np.count_nonzero(~kept)} of {len(time)} samples are left out"
    else:
        given = ~empty[:, :measured]
        first, final = given.argmax(axis=0).max(), (len(time) - 1 - given[::-1].argmax(axis=0)).min()
        kept = np.zeros(len(time), dtype=bool)
        kept[first : final + 1] = True
        widest = 0.0
        for i in range(measured):
            known = time[given[:, i]]
            values[:, i] = np.interp(time, known, values[given[:, i], i])
            if not given[:, i].all() and len(known) > 1:
                beside = np.searchsorted(known, time[~given[:, i]]).clip(1, len(known) - 1)
                widest = max(widest, float((known[beside] - known[beside - 1]).max()))
        done = f"positions are joined linearly over at most {widest:.4g} s, commands held"
    if not kept.any():
        raise FileFormatError(
            f"{path}: no sample has the positions of all joints ({', '.join(counts)} cells empty)"
        )
    notes.append(f"empty cells, of {len(time)}: {', '.join(counts)}; {done}")
    time = time[kept]
    return time - time[0], values[kept]
