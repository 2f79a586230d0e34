"""Files that users name, opened so that none can hang or flood: a pipe, a device, gigabytes where text is expected.

Text that they write by hand is read whole, with errors that say what is wrong with the file.
"""

from __future__ import annotations

import math
import os
import re
import stat
from typing import BinaryIO

from dqcontrol.errors import FileFormatError, unreadable

LARGEST_TEXT = 64_000_000  # bytes of a text that is read whole


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file to read it.

    Raises
    ------
    FileFormatError
        If it is a pipe, a device or a socket, which may never end.
    OSError
        If it cannot be opened.
    """
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        mode = os.fstat(descriptor).st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise FileFormatError(f"{path}: is no file, but a pipe or a device, which may never end")
        return os.fdopen(descriptor, "rb")  # a folder is refused here
    except BaseException:
        os.close(descriptor)
        raise


def read_whole(path: str | os.PathLike[str], most: int = LARGEST_TEXT) -> bytes:
    """Return the content of a file.

    Raises
    ------
    FileFormatError
        If there is no such file, it cannot be read, is no regular file, or larger than so many bytes.
    """
    try:
        with open_regular(path) as stream:
            size = os.fstat(stream.fileno()).st_size
            content = stream.read(most + 1) if size <= most else b""
    except OSError as error:
        raise unreadable(path, error) from None
    if max(size, len(content)) > most:
        raise FileFormatError(f"{path}: has {size / 1e6:,.1f} MB; at most {most / 1e6:g} MB are read")
    return content


def version(path: str | os.PathLike[str]) -> tuple[int, int, int]:
    """Return what tells a file from another that had its name before: its inode, time and size; zeros if it is missing.

    What is kept of files while a process lasts is kept by it too: files are written anew.
    """
    try:
        found = os.stat(path)
    except OSError:
        return 0, 0, 0
    return found.st_ino, found.st_mtime_ns, found.st_size


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a UTF-8 file.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileFormatError
        If there is no such file, it cannot be read, is too large, or is not text.
    """
    content = read_whole(path)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: not a text file (UTF-8): byte {error.start + 1} is no text") from None
    if "\0" in text:
        raise FileFormatError(f"{path}: not a text file: byte {content.index(0) + 1} is zero")
    return text


def as_number(where: str, word: str) -> float:
    """Return a finite number read from a file, or raise `FileFormatError` beginning with where it stands."""
    try:
        number = float(word)
    except ValueError:
        comma = "; decimals take a point" if re.fullmatch(r"[+-]?\d+,\d+", word.strip()) else ""
        raise FileFormatError(f"{where}: expected a number, got '{word:.40}'{comma}") from None
    if not math.isfinite(number):
        raise FileFormatError(f"{where}: must be finite, got {word}")
    return number
