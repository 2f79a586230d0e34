"""Which published experiments can be reproduced, and from which specs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dqcontrol.errors import UnknownNameError, unknown_name
from dqcontrol.experiments.tables import Column, Table

SOURCE = "pereira2016"
PLANT = "servo"  # what `reproduce` takes for the Meka unless told; see `published_specs.PLANTS`


@dataclass(frozen=True)
class Reproduction:
    """One published experiment.

    Attributes
    ----------
    about
        What it is, and its tables in the source.
    specs
        Names of the specs by the name that the published tables give their experiment.
    error
        The metric that stands for the source's error norm: of the whole run or of its settled part.
    scaled
        Whether the robust laws run a second time with gains scaled by the second fit.
    control_unit
        What the source's control signal counts in: 1 for rad/s, or the period in s where it printed T u for u.
    """

    about: str
    specs: Mapping[str, str] = field(default_factory=dict)
    error: str = "error.integral"
    scaled: bool = False
    control_unit: float = 1.0


REPRODUCTIONS = {
    "lqr": Reproduction("circle, both LQR laws, four pairs of weights (Tables 5.2–5.4)", {"": "lqr"}),
    "h-infinity": Reproduction(
        "spiral, five γ (Tables 5.5–5.7, eq. 5.8), and Definition 3.1 itself",
        {"": "h-infinity"},
        error="settled_error.integral",
        scaled=True,
    ),
    "circle": Reproduction("circle, six laws (Tables 5.8–5.9)", {"": "circle"}, scaled=True),
    "spiral": Reproduction(
        "spiral, six laws, three sets of gains, 50 repeats (Tables 5.10–5.15)", {"": "spiral"}, scaled=True
    ),
    "sampling-time": Reproduction(
        "periods kept in the real-time loop (Table 61, Figs 5.5–5.6)", {"": "sampling-time"}
    ),
    "circle-and-square": Reproduction(
        "circle and square, iiwa 7 and Meka (App. C, Tables 3–4)",
        {
            f"{robot} {shape}": f"{robot}-{shape}"
            for robot in ("iiwa", "meka")
            for shape in ("circle", "square")
        },
        control_unit=0.025,
    ),
    "lqr-surface": Reproduction(
        "circle over a grid of weights (App. D, Figs 7–8)", {"iiwa": "iiwa-surface", "meka": "meka-surface"}
    ),
    "light-painting": Reproduction("a drawing by LQR-DQ (Section 5.9)", {"": "light-painting"}),
    "calibration": Reproduction("the fit of the sag on one published cell, and the second fit of HIR"),
}


def reproduction(name: str) -> Reproduction:
    """Return a reproduction by name, with or without the source's.

    Raises
    ------
    UnknownNameError
        If there is none of that name.
    """
    short = name.removeprefix(f"{SOURCE}/")
    if short not in REPRODUCTIONS:
        raise unknown_name("reproduction", name, [f"{SOURCE}/{known}" for known in REPRODUCTIONS])
    return REPRODUCTIONS[short]


def names(name: str) -> list[str]:
    """Return the experiments that a name stands for: one, or all of a source.

    Raises
    ------
    UnknownNameError
        If there is none of that name.
    """
    if name == SOURCE:
        return list(REPRODUCTIONS)
    reproduction(name)
    return [name.removeprefix(f"{SOURCE}/")]


def catalogue_table() -> Table:
    """Return one row an experiment."""
    rows = [[f"{SOURCE}/{name}", each.about] for name, each in REPRODUCTIONS.items()]
    return Table([Column("name"), Column("experiment")], rows)


def spec_path(name: str) -> Path:
    """Return the file of a published experiment's spec.

    Raises
    ------
    UnknownNameError
        If there is none of that name.
    """
    folder = Path(__file__).parent / SOURCE / "specs"
    path = folder / f"{name}.yaml"
    if not path.is_file():
        known = sorted(spec.stem for spec in folder.glob("*.yaml"))
        raise UnknownNameError(f"spec: no '{name}'; there are {', '.join(known)}")
    return path
