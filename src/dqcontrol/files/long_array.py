"""Arrays over many samples: in memory as long as they are small, in a file that has no name otherwise."""

from __future__ import annotations

import errno
import math
import mmap
import os
import tempfile
from collections.abc import Callable

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import Error

_IN_MEMORY = 32 << 20  # bytes of an array
BLOCK = 1 << 16  # rows that are worked on at once


def long_array(*shape: int) -> Array:
    """Return a new array, not initialised; a long one lies in a temporary file, which ends with it.

    The system keeps of such a file in memory what there is room for. It lies where `tempfile` puts files: ``TMPDIR``
    says where. Its room on the disk is taken at once: a full disk is said here.

    Parameters
    ----------
    shape
        Of the array.

    Raises
    ------
    Error
        If there is no room for the file.

    Examples
    --------
    >>> long_array(4, 8).shape
    (4, 8)
    """
    size = 8 * math.prod(shape)
    if size <= _IN_MEMORY or not hasattr(os, "posix_fallocate"):
        return np.empty(shape)
    try:
        with tempfile.TemporaryFile() as file:
            os.posix_fallocate(file.fileno(), 0, size)
            return np.frombuffer(mmap.mmap(file.fileno(), size)).reshape(shape)
    except OSError as error:
        if error.errno == errno.EINVAL:  # a file system that cannot promise room
            return np.empty(shape)
        raise Error(
            f"{tempfile.gettempdir()}: no room for {size / 1e9:.2g} GB of samples ({error.strerror}); set TMPDIR to a "
            "folder that has it, or run fewer steps"
        ) from None


def row_by_row(function: Callable[..., Array], *rows: Array) -> Array:
    """Return what a function makes of each row, worked out in blocks so that its scratch stays small.

    Parameters
    ----------
    function
        Of arrays of the same rows, shape (k, …): one row or number for each.
    rows
        Arrays of as many rows.

    Examples
    --------
    >>> import numpy as np
    >>> row_by_row(lambda rows: rows.sum(axis=1), np.arange(6.0).reshape(3, 2)).tolist()
    [1.0, 5.0, 9.0]
    """
    found = function(*(each[:BLOCK] for each in rows))
    count = len(rows[0])
    if count <= BLOCK:
        return found
    out = long_array(count, *found.shape[1:])
    out[:BLOCK] = found
    for first in range(BLOCK, count, BLOCK):
        out[first : first + BLOCK] = function(*(each[first : first + BLOCK] for each in rows))
    return out
