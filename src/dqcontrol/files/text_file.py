"""Text files that users write by hand: read whole, with errors that say what is wrong with the file."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

from dqcontrol.errors import FileFormatError, suggest_file
from dqcontrol.files.input_file import read_whole


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a UTF-8 file.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileFormatError
        If there is no such file, it cannot be read, or it is not text.
    """
    file = Path(path)
    try:
        content = read_whole(file)
    except FileNotFoundError:
        raise FileFormatError(f"{path}: no such file{suggest_file(file)}") from None
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
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
