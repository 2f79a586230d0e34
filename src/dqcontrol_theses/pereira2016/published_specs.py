"""The specs of the published experiments, with the Meka on servos or in physics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dqcontrol.errors import unknown_name
from dqcontrol.files import read_yaml
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PHYSICS, PLANTS, drawings, spec_path
from dqcontrol_theses.printed import with_printed_inverse

_MEKA = "meka-a2"
_APPENDIX_C = ("meka-circle", "meka-square", "meka-surface")
APPENDIX_C_STIFFNESS = 0.7
"""Of the Meka in appendices C and D, which are of another session: their one unknown, fitted on Err of K, circle."""


def published_spec(name: str, plant: str = PLANTS[0]) -> dict[str, Any]:
    """Return a published experiment's spec, file names absolute; a simulated iiwa keeps its servos on any plant.

    Parameters
    ----------
    name
        Of its file.
    plant
        One of `PLANTS`.

    Raises
    ------
    UnknownNameError
        If there is no such spec or plant.
    """
    if plant not in PLANTS:
        raise unknown_name("plant", plant, PLANTS)
    path = spec_path(name)
    data = with_printed_inverse(_read(path))
    if "file" in data["reference"]:
        data["reference"]["file"] = str(path.parent / data["reference"]["file"])
    if plant == PHYSICS and data["robot"] == _MEKA:
        data["plant"] = _read(Path(__file__).parent / f"{PHYSICS}.yaml")
        if name in _APPENDIX_C:
            data["plant"]["stiffness"] = APPENDIX_C_STIFFNESS
    return data


def drawing_specs(plant: str = PLANTS[0]) -> dict[str, dict[str, Any]]:
    """Return the specs of P16's light paintings by the names of their drawings."""
    data = published_spec("light-painting", plant)
    return {
        name: data | {"name": name, "reference": data["reference"] | {"file": str(file)}}
        for name, file in drawings().items()
    }


def _read(path: Path) -> dict[str, Any]:
    return read_yaml(path, dict[str, Any])
