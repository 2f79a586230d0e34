"""The robust laws with all gains scaled by one factor: a second fit, labelled as such, and no evidence for anything.

[P16]'s robust laws reach errors as small as those of K with gains that are 30 times smaller. On servos that sag, the
error of every law is the sag over its gain: the printed gains cannot have been applied on the same scale. With all
gains of HIR and HIRT times `FACTOR`, fitted on one published cell, the other cells can be looked at.
"""

from __future__ import annotations

from typing import Any

from dqcontrol.reproductions.pereira2016.pereira2016_catalogue import PLANTS
from dqcontrol.reproductions.pereira2016.published_specs import published_spec

FACTOR = 93.7  # `dqcontrol reproduce pereira2016/calibration` fits it
LAWS = ("HIR", "HIRT")
SUFFIX = " scaled"
_GAINS = ("orientation_gain", "translation_gain")


def scaled_spec(name: str, plant: str = PLANTS[0], *, factor: float = FACTOR) -> dict[str, Any]:
    """Return a published spec with the robust laws only, their gains scaled and their labels saying so."""
    data = published_spec(name, plant)
    data["name"] = f"{data['name']}-scaled"
    data["laws"] = _scaled(data["laws"], factor)
    sets = {label: _scaled(laws, factor) for label, laws in data.pop("parameter_sets", {}).items()}
    if sets:
        data["parameter_sets"] = {label: laws for label, laws in sets.items() if laws}
    return data


def _scaled(laws: dict[str, dict[str, Any]], factor: float) -> dict[str, dict[str, Any]]:
    return {law + SUFFIX: _with_scaled_gains(laws[law], factor) for law in LAWS if law in laws}


def _with_scaled_gains(law: dict[str, Any], factor: float) -> dict[str, Any]:
    return {key: _times(value, factor) if key in _GAINS else value for key, value in law.items()}


def _times(gain: Any, factor: float) -> Any:
    if isinstance(gain, dict):
        return gain | {"values": [factor * value for value in gain["values"]]}
    return factor * gain
