"""What an experiment is: one YAML file, typed, bounded and described here."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
import yaml
from msgspec import UNSET, Meta, UnsetType

from dqcontrol.errors import FileFormatError, ShapeError
from dqcontrol.experiments.reference_spec import AnyReference, Part
from dqcontrol.laws import (
    ClassicProportional,
    DecoupledProportional,
    HInfinity,
    HInfinityTracking,
    LinearQuadraticDQ,
    LinearQuadraticR8,
    OpenLoop,
    PartialProportional,
    Proportional,
    ProportionalFeedforward,
)
from dqcontrol.limits import CommandLimits
from dqcontrol.loop import Stop
from dqcontrol.plants import CompliantPlant, Disturbance, Integrator, MujocoPlant, Servo
from dqcontrol.yaml_file import convert, parse_yaml, read_text

AnyLaw = (
    OpenLoop
    | ClassicProportional
    | Proportional
    | DecoupledProportional
    | PartialProportional
    | ProportionalFeedforward
    | HInfinity
    | HInfinityTracking
    | LinearQuadraticR8
    | LinearQuadraticDQ
)
AnyPlant = Integrator | Servo | MujocoPlant | CompliantPlant

_Label = Annotated[
    str,
    Meta(
        pattern=r"^(?!\.)[^/\\\x00-\x1f]{1,60}\Z",
        description="labels of at most 60 characters without / and \\, not beginning with a dot",
    ),
]


class RobotSpec(Part, frozen=True, kw_only=True):
    """A robot by name or file, and the ends of its chain."""

    source: Annotated[
        str, Meta(min_length=1, description="preset, .yaml or .urdf, or example-robot-data:PATH")
    ]
    base_link: str | None = None
    tip_link: str | None = None


class Spec(Part, frozen=True, kw_only=True):
    """An experiment: one robot and one reference; one law and one plant, or several of each.

    Parameters
    ----------
    name
        Names the folder of results.
    robot
        Name, file, or source with base and tip link.
    start
        Start configuration, one number a joint, rad or m.
    period
        T, control period, s.
    reference
        The desired motion.
    duration
        s; default: as long as the reference.
    law, laws
        One law, or several by label.
    plant, plants
        One plant, or several by label.
    limits
        What is done to the commands before they leave.
    disturbance
        What moves the hand beside the commands; not for physics.
    seed
        Of all noise.
    stop
        When to end a run early.
    settle
        Length of the start that the settled errors leave out, s.
    """

    name: Annotated[
        str,
        Meta(
            pattern=r"^(?!\.)[\w.-]{1,60}\Z",
            description="at most 60 letters, digits, _ . - and no dot first",
        ),
    ]
    robot: str | RobotSpec
    start: Annotated[list[float], Meta(min_length=1, description="rad or m")]
    period: Annotated[float, Meta(gt=0, le=10, description="s")]
    reference: AnyReference
    duration: Annotated[float, Meta(gt=0, le=1e5, description="s")] | None = None
    law: AnyLaw | UnsetType = UNSET
    laws: Annotated[dict[_Label, AnyLaw], Meta(min_length=1)] | UnsetType = UNSET
    plant: AnyPlant | UnsetType = UNSET
    plants: Annotated[dict[_Label, AnyPlant], Meta(min_length=1)] | UnsetType = UNSET
    limits: CommandLimits = CommandLimits()
    disturbance: Disturbance | None = None
    seed: Annotated[int, Meta(ge=0)] = 0
    stop: Stop | None = None
    settle: Annotated[float, Meta(ge=0, description="s")] = 0.0

    @property
    def law_by_label(self) -> dict[str, AnyLaw]:
        """All laws by label; a single law's label is its kind."""
        return _by_label("law", self.law, self.laws)

    @property
    def plant_by_label(self) -> dict[str, AnyPlant]:
        """All plants by label; a single plant's label is its kind."""
        return _by_label("plant", self.plant, self.plants)

    @property
    def is_single(self) -> bool:
        """Whether it describes one run."""
        return len(self.law_by_label) == 1 and len(self.plant_by_label) == 1


def _by_label(field: str, one: Any, several: Any) -> dict[str, Any]:
    if (one is UNSET) == (several is UNSET):
        raise ShapeError(f"{field}: give either '{field}' (one) or '{field}s' (several by label)")
    return dict(several) if one is UNSET else {type(one).__struct_config__.tag: one}


def read_spec(source: str | Path | dict[str, Any]) -> tuple[Spec, Path]:
    """Return a spec and the folder that its relative file names start from.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary (file names are then relative to the working folder).

    Raises
    ------
    FileFormatError
        If the file is missing, malformed, or has an unknown or unfit key: ``path: field: …``.
    """
    if isinstance(source, dict):
        where, folder = "spec", Path.cwd()
        try:
            data = msgspec.to_builtins(source, enc_hook=_plain)
        except (TypeError, NotImplementedError) as error:
            raise FileFormatError(f"{where}: {error}") from None
    else:
        where, folder = str(source), Path(source).resolve().parent
        data = parse_yaml(where, read_text(where))
    if not isinstance(data, dict):
        raise FileFormatError(
            f"{where}: is empty or no mapping; it needs name, robot, start, period, reference, law, plant"
        )
    spec = convert(where, data, Spec)
    for check in ("law_by_label", "plant_by_label"):
        try:
            getattr(spec, check)
        except ShapeError as error:
            raise FileFormatError(f"{where}: {error}") from None
    return spec, folder


def _plain(value: Any) -> Any:
    """Return NumPy's arrays and numbers, and paths, as what a YAML file would give."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"cannot hold {value!r:.80}")


def spec_text(spec: Spec, folder: Path) -> str:
    """Return the YAML of a spec with all defaults and absolute file names, so that it runs anywhere."""
    data = msgspec.to_builtins(spec)
    _make_absolute(data["reference"], folder)
    robot = data["robot"] if isinstance(data["robot"], dict) else {"source": data["robot"]}
    if (folder / robot["source"]).is_file():
        robot["source"] = str((folder / robot["source"]).resolve())
        data["robot"] = robot
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)


def _make_absolute(reference: dict[str, Any], folder: Path) -> None:
    """Make the file names of a reference, and of those that it is made of, absolute."""
    if "file" in reference:
        reference["file"] = str((folder / reference["file"]).resolve())
    for part in reference.get("references", ()):
        _make_absolute(part, folder)
