"""What an experiment is: one YAML file, typed, bounded and described here."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import msgspec
import numpy as np
import yaml
from msgspec import UNSET, Meta, UnsetType

from dqcontrol.errors import Error, FileFormatError, ShapeError
from dqcontrol.experiments.spec.old_keys import rename_old_keys
from dqcontrol.experiments.spec.parameter_sets import Changes, Label, Variant, variants
from dqcontrol.experiments.spec.reference_spec import AnyReference, Part
from dqcontrol.experiments.spec.spec_files import locate_controllers, locate_files
from dqcontrol.extensions.registry import union_of
from dqcontrol.extensions.user_code import admit, place_of
from dqcontrol.files.yaml_file import convert, parse_yaml, read_text
from dqcontrol.laws import Law
from dqcontrol.laws.null_space import AnyNullSpace
from dqcontrol.limits import CommandLimits, Supervisor
from dqcontrol.loop import Stop
from dqcontrol.plants import Disturbance, Plant, limits_before
from dqcontrol.robots import Robot

if TYPE_CHECKING:
    AnyLaw: TypeAlias = Law
    AnyPlant: TypeAlias = Plant
else:
    AnyLaw = union_of(Law, "dqcontrol.laws")
    AnyPlant = union_of(Plant, "dqcontrol.plants")
MetricsFrom = Literal["true", "measured"]


class RobotSpec(Part, frozen=True, kw_only=True):
    """A robot by name or file, and the ends of its chain."""

    source: Annotated[
        str, Meta(min_length=1, description="preset, .yaml or .urdf, or example-robot-data:PATH")
    ]
    base_link: str | None = None
    tip_link: str | None = None


class StartedRobotSpec(RobotSpec, frozen=True, kw_only=True):
    """A robot and where it starts."""

    start: Annotated[list[float], Meta(min_length=1, description="rad or m")]

    def without_start(self) -> RobotSpec:
        """Return the robot alone."""
        return RobotSpec(source=self.source, base_link=self.base_link, tip_link=self.tip_link)


class Spec(Part, frozen=True, kw_only=True):
    """An experiment: one reference; robots, laws with their parameters and plants, one or several of each; repeats.

    Parameters
    ----------
    name
        Names the folder of results.
    robot, start
        Name, file, or source with base and tip link; start configuration, one number a joint, rad or m.
    robots
        In their place several by label, each with its ``start``.
    period
        T, control period, s.
    reference
        The desired motion; from each robot's own start.
    duration
        s; default: as long as the reference.
    law, laws
        One law, or several by label.
    parameter_sets
        Named parameter sets: by label the laws that take part, each with those of its keys that differ.
    grids
        By law and key a list of values; each combination is a parameter set of that law.
    plant, plants
        One plant, or several by label.
    limits
        What is done to the commands before they leave; velocities are scaled before servos and physics unless
        ``velocity`` is false.
    supervisor
        What stands between law and plant; ``true``: with default parameters. If omitted, that before plants that move
        more than our own arrays, and nothing before the others.
    disturbance
        What moves the hand beside the commands; not for physics.
    repeats
        How often each combination runs; the seed of repeat k is ``seed`` + k for all laws, so differences are paired.
    seed
        Of all noise.
    record
        ``"all"`` keeps every sample of every trial, ``"metrics"`` only the numbers that judge it; default: all without
        repeats, metrics with them.
    stop
        When to end a run early.
    skip_initial
        Length of the start that the settled errors leave out, s.
    metrics_from
        ``"true"``: metrics are computed from the true joint angles; ``"measured"``: from those that the
        encoders gave, as on a real robot.
    null_space
        Of all laws that name none.
    """

    name: Annotated[
        str,
        Meta(
            pattern=r"^(?!\.)[\w.-]{1,60}\Z",
            description="at most 60 letters, digits, _ . - and no dot first",
        ),
    ]
    robot: str | RobotSpec | UnsetType = UNSET
    start: Annotated[list[float], Meta(min_length=1, description="rad or m")] | None = None
    robots: Annotated[dict[Label, StartedRobotSpec], Meta(min_length=1)] | UnsetType = UNSET
    period: Annotated[float, Meta(gt=0, le=10, description="s")]
    reference: AnyReference
    duration: Annotated[float, Meta(gt=0, le=1e5, description="s")] | None = None
    law: AnyLaw | UnsetType = UNSET
    laws: Annotated[dict[Label, AnyLaw], Meta(min_length=1)] | UnsetType = UNSET
    parameter_sets: (
        Annotated[dict[Label, Annotated[dict[str, Changes], Meta(min_length=1)]], Meta(min_length=1)] | None
    ) = None
    grids: (
        Annotated[
            dict[str, Annotated[dict[str, Annotated[list[Any], Meta(min_length=1)]], Meta(min_length=1)]],
            Meta(min_length=1),
        ]
        | None
    ) = None
    plant: AnyPlant | UnsetType = UNSET
    plants: Annotated[dict[Label, AnyPlant], Meta(min_length=1)] | UnsetType = UNSET
    limits: CommandLimits = CommandLimits()
    supervisor: Supervisor | bool | None = None
    disturbance: Disturbance | None = None
    repeats: Annotated[int, Meta(ge=1, le=1_000_000)] = 1
    seed: Annotated[int, Meta(ge=0, le=2**62)] = 0
    record: Literal["all", "metrics"] | None = None
    stop: Stop | None = None
    skip_initial: Annotated[float, Meta(ge=0, description="s")] = 0.0
    metrics_from: MetricsFrom = "true"
    null_space: AnyNullSpace | None = None

    @property
    def robot_by_label(self) -> dict[str, StartedRobotSpec]:
        """All robots by label; a single robot's label is empty."""
        if (self.robot is UNSET) == (self.robots is UNSET):
            raise ShapeError("robot: give either 'robot' with 'start' (one) or 'robots' (several by label)")
        if not isinstance(self.robots, UnsetType):
            if self.start is not None:
                raise ShapeError("start: each of 'robots' has its own; give it there")
            return dict(self.robots)
        if self.start is None:
            raise ShapeError("missing key 'start'")
        one = self.robot if isinstance(self.robot, RobotSpec) else RobotSpec(source=str(self.robot))
        return {"": StartedRobotSpec(**msgspec.structs.asdict(one), start=self.start)}

    @property
    def law_by_label(self) -> dict[str, AnyLaw]:
        """All laws by label, without sets and grids; a single law's label is its kind."""
        return _by_label("law", self.law, self.laws)

    @property
    def plant_by_label(self) -> dict[str, AnyPlant]:
        """All plants by label; a single plant's label is its kind."""
        return _by_label("plant", self.plant, self.plants)

    def supervisor_of(self, plant: AnyPlant) -> Supervisor | None:
        """Return what stands before a plant, if anything."""
        if isinstance(self.supervisor, Supervisor):
            return self.supervisor
        wanted = plant.is_supervised if self.supervisor is None else self.supervisor
        return Supervisor() if wanted else None

    def limits_of(self, plant: AnyPlant, robot: Robot) -> CommandLimits:
        """Return what is done to commands before a plant."""
        return limits_before(plant, self.limits, robot)

    @property
    def variants(self) -> list[Variant[AnyLaw]]:
        """All laws with the parameters of their sets and grids, in the order that they run in."""
        laws = {label: self._with_null_space(law) for label, law in self.law_by_label.items()}
        return variants(laws, self.parameter_sets, self.grids)

    def _with_null_space(self, law: AnyLaw) -> AnyLaw:
        if self.null_space is None or law.null_space is not None:
            return law
        return msgspec.structs.replace(law, null_space=self.null_space)

    @property
    def keeps_records(self) -> bool:
        """Whether every sample is kept."""
        return self.repeats == 1 if self.record is None else self.record == "all"

    @property
    def is_single(self) -> bool:
        """Whether it describes one run."""
        return not self.several

    @property
    def several(self) -> str:
        """What it has several of, as in ``2 laws, 3 repeats``; empty if it describes one run."""
        counts = {
            "robots": len(self.robot_by_label),
            "laws": len(self.variants),
            "plants": len(self.plant_by_label),
            "repeats": self.repeats,
        }
        return ", ".join(f"{count} {what}" for what, count in counts.items() if count > 1)


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
    where, data, folder = read_data(source)
    if "sweep" in data:
        raise FileFormatError(f"{where}: sweep: describes a parameter study; run it with 'dqcontrol sweep'")
    return as_spec(where, data, folder), folder


def read_data(source: str | Path | dict[str, Any]) -> tuple[str, dict[str, Any], Path]:
    """Return the name, the plain data and the folder of a spec, not yet checked; see `read_spec`."""
    if not isinstance(source, str | Path | dict):
        raise ShapeError(f"spec: expected the path of a YAML file or a dictionary, got {source!r:.80}")
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
    rename_old_keys(where, data)
    return where, data, folder


def as_spec(where: str, data: dict[str, Any], folder: Path) -> Spec:
    """Return plain data as a spec; ``where`` is for the messages."""
    rename_old_keys(where, data)
    locate_controllers(data, folder)
    admit(where, data, folder)
    spec = convert(where, data, Spec)
    for check in ("robot_by_label", "plant_by_label", "variants"):
        try:
            getattr(spec, check)
        except Error as error:
            raise FileFormatError(f"{where}: {error}") from None
    return spec


def _plain(value: Any) -> Any:
    """Return NumPy's arrays and numbers, paths and functions as what a YAML file would give."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    if callable(value):
        return place_of(value)
    raise TypeError(f"cannot hold {value!r:.80}")


def spec_text(spec: Spec, folder: Path) -> str:
    """Return the YAML of a spec with all defaults and absolute file names, so that it runs anywhere."""
    data = msgspec.to_builtins(spec)
    locate_files(data, folder)
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
