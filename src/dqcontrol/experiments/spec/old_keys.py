"""Keys of specs under their old names: they are read for one more release, with a warning that names the new one."""

from __future__ import annotations

import warnings
from typing import Any

from dqcontrol.errors import FileFormatError

_OLD = {"judged": "metrics_from", "settle": "skip_initial", "sets": "parameter_sets"}
_OLD_OF_DRIVE_TO = {"share": "speed_fraction"}


def rename_old_keys(where: str, data: Any) -> None:
    """Rename the old keys of a spec, or of the spec of an evaluated log, in place.

    Parameters
    ----------
    where
        The file, for the messages.
    data
        As read; keys that a parameter study varies are renamed too.

    Raises
    ------
    FileFormatError
        If a key stands there under both names.
    """
    if not isinstance(data, dict):
        return
    _rename(where, data, _OLD, "")
    reference = data.get("reference")
    drives = False
    if isinstance(reference, dict) and reference.get("kind") == "drive-to":
        drives = True
        _rename(where, reference, _OLD_OF_DRIVE_TO, "reference.")
    if isinstance(evaluation := data.get("evaluation"), dict):
        _rename(where, evaluation, _OLD, "evaluation.")
    sweep = data.get("sweep")
    if isinstance(sweep, dict) and isinstance(over := sweep.get("over"), dict):
        varied = {f"reference.{old}": f"reference.{new}" for old, new in _OLD_OF_DRIVE_TO.items()}
        _rename(where, over, _OLD | (varied if drives else {}), "sweep.over.")


def _rename(where: str, data: dict[str, Any], old_names: dict[str, str], prefix: str) -> None:
    if data.keys().isdisjoint(old_names):
        return
    for old, new in old_names.items():
        if old in data and new in data:
            raise FileFormatError(
                f"{where}: {prefix}{old}: is the old name of '{new}', which stands there too"
            )
        if old in data:
            warnings.warn(
                f"{where}: {prefix}{old} is now called {prefix}{new}; the old name is read for one more release",
                FutureWarning,
                stacklevel=2,
            )
    renamed = {old_names.get(key, key): value for key, value in data.items()}  # in the same order
    data.clear()
    data.update(renamed)
