"""Experiments of [P16] that can be reproduced, their specs, with the Meka on servos or in physics, and single runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from dqcontrol.errors import UnknownNameError, unknown_name
from dqcontrol.experiments import PreparedExperiment, execute, measure, prepare
from dqcontrol.files import read_yaml
from dqcontrol.loop import Record
from dqcontrol.measures import Metrics
from dqcontrol_theses.catalogue import Experiment
from dqcontrol_theses.printed import with_printed_inverse

SOURCE = "pereira2016"
SERVO, PHYSICS = "servo", "meka-physics"
PLANTS = (PHYSICS, SERVO)  # what can stand for the Meka, the default first: all of these ran on the arm

MEKA_CONTROLLERS = Path(str(files("dqcontrol") / "plants/compliant/controllers/meka-a2.yaml"))

_MEKA = "meka-a2"
_APPENDIX_C = ("meka-circle", "meka-square", "meka-surface")
APPENDIX_C_STIFFNESS = 0.7
"""Of the Meka in appendices C and D, which are of another session: their one unknown, fitted on Err of K, circle."""

EXACT = " exact"
"""Appended to the label of LQR-R8 where its Riccati equation is solved exactly, not as printed."""


@dataclass(frozen=True)
class Reproduction(Experiment):
    """One experiment of [P16].

    Attributes
    ----------
    about
        What it is, and its tables in [P16].
    plants
        What can stand for the Meka.
    specs
        Names of the specs by the name that the published tables give their experiment.
    error
        The metric that stands for the source's error norm: of the whole run or of its settled part.
    robust
        Whether the robust laws run, which do so a second time with a hundred times their printed gains.
    control_unit
        What the source's control signal counts in: 1 for rad/s, or the period in s where it printed T u for u.
    """

    plants: tuple[str, ...] = PLANTS
    specs: Mapping[str, str] = field(default_factory=dict)
    error: str = "error.integral"
    robust: bool = False
    control_unit: float = 1.0


EXPERIMENTS = {
    "lqr": Reproduction("circle, both LQR laws, four pairs of weights (Tables 5.2–5.4)", specs={"": "lqr"}),
    "h-infinity": Reproduction(
        "spiral, five γ (Tables 5.5–5.7, eq. 5.8), and Definition 3.1 itself",
        specs={"": "h-infinity"},
        error="settled_error.integral",
        robust=True,
    ),
    "circle": Reproduction("circle, six laws (Tables 5.8–5.9)", specs={"": "circle"}, robust=True),
    "spiral": Reproduction(
        "spiral, six laws, three sets of gains, 50 repeats (Tables 5.10–5.15)",
        specs={"": "spiral"},
        robust=True,
    ),
    "sampling-time": Reproduction(
        "periods kept in the real-time loop (Table 61, Figs 5.5–5.6), calculations of rigid motions counted",
        specs={"": "sampling-time"},
    ),
    "circle-and-square": Reproduction(
        "circle and square, iiwa 7 and Meka (App. C, Tables 3–4)",
        specs={
            f"{robot} {shape}": f"{robot}-{shape}"
            for robot in ("iiwa", "meka")
            for shape in ("circle", "square")
        },
        control_unit=0.025,
    ),
    "lqr-surface": Reproduction(
        "circle over a grid of weights (App. D, Figs 7–8)",
        specs={"iiwa": "iiwa-surface", "meka": "meka-surface"},
    ),
    "light-painting": Reproduction("six drawings by LQR-DQ (Fig. 5.7)", specs={"": "light-painting"}),
    "tuned-comparison": Reproduction("the six laws, each tuned, and what learning makes of the spiral"),
    "writing": Reproduction("the drawing below a millimetre: tuned, with feed-forward, learnt (Section 5.9)"),
    "calibration": Reproduction(
        "the fit of the plant on one published cell; the scale of HIR's gains from printed numbers"
    ),
}


def drawings() -> dict[str, Path]:
    """Return the files of the drawings that stand for Figures 5.7(a) to (f), by their names."""
    names = ("house", "light-bulb", "flower", "boat", "fish", "star")
    folder = Path(__file__).parent / "specs" / "drawings"
    return {name: folder / f"{name}.txt" for name in names}


def spec_path(name: str) -> Path:
    """Return the file of a published experiment's spec.

    Raises
    ------
    UnknownNameError
        If no experiment has that name.
    """
    folder = Path(__file__).parent / "specs"
    path = folder / f"{name}.yaml"
    if not path.is_file():
        known = sorted(spec.stem for spec in folder.glob("*.yaml"))
        raise UnknownNameError(f"spec: no '{name}'; there are {', '.join(known)}")
    return path


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


class SpecRun(NamedTuple):
    """One run of a law, and its metrics as the encoders have them, from which the published numbers come."""

    setting: PreparedExperiment
    record: Record
    metrics: Metrics


def run_once(spec: dict[str, Any], law: str, label: str = "", **parameters: Any) -> SpecRun:
    """Run one law of a spec once, with one of its sets, and perhaps other values of some of its parameters."""
    data: dict[str, Any] = spec | {"repeats": 1}
    sets = data.pop("parameter_sets", {})
    own = sets[label][law] if label else {}
    setting = prepare(data | {"laws": {law: data["laws"][law] | own | parameters}})
    record = execute(setting, setting.cases[0])
    return SpecRun(
        setting, record, measure(record, setting.scene.robot, setting.spec.skip_initial, "measured")
    )
