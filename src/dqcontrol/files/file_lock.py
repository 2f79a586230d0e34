"""Locks of files and folders among the processes of a machine; they end with the process."""

from __future__ import annotations

import os
from pathlib import Path


def locked(path: Path, *, waits: bool = False) -> int | None:
    """Lock a file, which is made if missing, or a folder, and return the descriptor whose closing releases it.

    Parameters
    ----------
    path
        What is locked.
    waits
        Whether to wait for a process that holds it.

    Returns
    -------
    int or None
        None on Windows, where nothing is locked.

    Raises
    ------
    BlockingIOError
        If another living process holds it, and nobody waits.
    OSError
        If it cannot be opened or locked.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX if waits else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor
