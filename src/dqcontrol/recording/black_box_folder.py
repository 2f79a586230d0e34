"""What a black box holds, written as the folder of a run."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.errors import writing
from dqcontrol.loop.black_box import BlackBox
from dqcontrol.loop.record import Record
from dqcontrol.recording.mcap import save_record

FOLDER = "black-box"  # its name in a folder of results


def save_black_box(black_box: BlackBox, folder: str | Path, spec: str, stopped: str) -> Path:
    """Write it as a folder that `dqcontrol figures` and ``view`` read; a number is added if there is one already.

    Parameters
    ----------
    black_box
        With at least one sample.
    folder
        Wanted name.
    spec
        Text of the experiment.
    stopped
        Why the robot stopped.

    Returns
    -------
    The folder.

    Raises
    ------
    Error
        If it holds nothing, or cannot be written.

    Examples
    --------
    >>> save_black_box(supervision.black_box, "out/black-box", spec, trace.stopped)  # doctest: +SKIP
    """
    return save_last_seconds(black_box.record(stopped), folder, spec)


def save_last_seconds(record: Record, folder: str | Path, spec: str) -> Path:
    """Do the same with what `BlackBox.record` gave, which may take seconds."""
    path, number = Path(folder), 1
    with writing(folder):
        while path.exists():
            number += 1
            path = Path(f"{folder}-{number}")
        path.mkdir(parents=True)
        (path / "spec.yaml").write_text(spec, encoding="utf-8")
        save_record(record, path / "record.mcap", spec)
    return path
