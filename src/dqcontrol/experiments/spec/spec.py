"""The spec of an experiment: one YAML file, typed, bounded and described."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Collection, Sequence
from functools import cache, cached_property
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.contact import Admittance
from dqcontrol.controller import PreparedTasks
from dqcontrol.controller.task_levels import POSTURE, FurtherTask, TaskPart
from dqcontrol.errors import (
    Error,
    FileFormatError,
    NoteWarning,
    ShapeError,
    ValueRangeError,
    as_array,
    error_prefix,
)
from dqcontrol.experiments.outcome import Expectation
from dqcontrol.experiments.spec.key_types import (
    kinds_below,
    kinds_of,
    numbers_for_quantities,
    quantities_for_numbers,
)
from dqcontrol.experiments.spec.parameter_sets import Changes, Label, Variant, variants
from dqcontrol.experiments.spec.reference_spec import (
    AnyReference,
    Part,
    Quaternion,
    Vector,
    gripped_by_steps,
    reference_data,
    rotation_from,
)
from dqcontrol.experiments.spec.spec_files import complete_plants, locate_files, use_copies
from dqcontrol.experiments.spec.world_file import said_world
from dqcontrol.extensions.registry import union_of
from dqcontrol.extensions.user_code import admit, place_of
from dqcontrol.files.input_file import read_text
from dqcontrol.files.output_file import yaml_text
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.laws import AnyNullSpace, Law
from dqcontrol.limits import CommandLimits
from dqcontrol.loop import Stop
from dqcontrol.plants import Disturbance, GripperEvent, Plant, limits_before
from dqcontrol.references import Reference
from dqcontrol.references.set_points import GripperStep, held_by_steps, never_held
from dqcontrol.robots import (
    PoseTask,
    ReachingPosture,
    Robot,
    SerialArm,
    TreeRobot,
    TwoArms,
    load_robot,
    postures,
)
from dqcontrol.robots.files.load import robot_from
from dqcontrol.robots.files.robot_file import plain_arm
from dqcontrol.robots.tree_robot import Root, TaskKind, chain_as_tree
from dqcontrol.supervisor import Supervisor
from dqcontrol.world import World
from dqcontrol.world.world import Bodies

if TYPE_CHECKING:
    AnyLaw: TypeAlias = Law
    AnyPlant: TypeAlias = Plant
else:
    AnyLaw = union_of(Law, "dqcontrol.laws")
    AnyPlant = union_of(Plant, "dqcontrol.plants")
MetricsFrom = Literal["true", "measured"]


class TaskSpec(Part, frozen=True, kw_only=True):
    """What of two arms, or of another tree, is driven; see `robots.PoseTask`."""

    kind: TaskKind
    frames: Annotated[list[str], Meta(max_length=2)] = []
    root: Root = "midpoint"
    point: Annotated[Vector, Meta(description="of the first frame, m")] = (0.0, 0.0, 0.0)
    axis: Annotated[Vector, Meta(description="in the first frame, taken for its z axis")] = (0.0, 0.0, 1.0)

    def task(self) -> PoseTask:
        """Return the task."""
        return PoseTask(self.kind, tuple(self.frames), self.root, point=self.point, axis=self.axis)


class RobotSpec(Part, frozen=True, kw_only=True):
    """A robot by name or file, and the ends of its chain; or the content of a robot file.

    ``tips`` are links of a URDF or MJCF file, or ``all``: the robot is the tree of joints above them, the first one is
    its task, and ``base_link`` the frame in which that is given. ``task`` says what of two arms, or of a tree, is
    driven: ``relative``, ``absolute``, ``left``, ``right``, the name of a frame, or a mapping.
    """

    source: (
        Annotated[str, Meta(min_length=1, description="preset, .yaml or .urdf, or example-robot-data:PATH")]
        | None
    ) = None
    base_link: str | None = None
    tip_link: str | None = None
    model: Annotated[dict[str, Any] | None, Meta(description="content of a robot file")] = None
    tips: list[str] | Literal["all"] | None = None
    task: str | TaskSpec | None = None

    def load(self, folder: Path | None = None) -> Robot:
        """Return the robot; relative file names start from a folder.

        Raises
        ------
        Error
            As `dqcontrol.robots.load_robot`.
        """
        if (self.source is None) == (self.model is None):
            raise ShapeError("robot: give either 'source' or 'model'")
        if self.model is not None:
            robot: Robot = robot_from("robot.model", self.model)
        else:
            source = str(self.source)
            near = (folder or Path()) / source
            place = near if near.is_file() else source
            if self.tips is None:
                robot = load_robot(place, self.base_link, self.tip_link)
            elif self.tip_link is not None:
                raise ShapeError("robot: give either 'tip_link' (a chain) or 'tips' (a tree)")
            else:
                robot = load_robot(place, self.base_link, tips=self.tips)
        if self.task is None:
            return robot
        if not isinstance(robot, TreeRobot):
            raise ShapeError(
                f"robot.task: {robot.name} is one chain and has one end effector; tasks are for two arms and trees"
            )
        with error_prefix("robot.task"):
            return robot.with_task(self.task.task() if isinstance(self.task, TaskSpec) else self.task)


class FurtherTaskSpec(Part, frozen=True, kw_only=True):
    """A task beside that of the law; see `controller.FurtherTask`.

    Without ``reference`` the pose at the start is held. ``posture`` is where the joints are to be: of the task
    ``posture``, with which it is where they start if omitted.
    """

    task: str | TaskSpec
    gain: Annotated[float, Meta(ge=0, description="k, 1/s; 0: corrects nothing")]
    reference: AnyReference | None = None
    level: Annotated[
        int, Meta(ge=0, le=9, description="0: before the law's task, 1: with it, 2: after it")
    ] = 2
    weight: Annotated[float, Meta(gt=0, description="against tasks of the same level")] = 1.0
    part: TaskPart = "pose"
    posture: Annotated[list[float] | None, Meta(description="rad or m")] = None

    def further_task(self, robot: Robot, start: Array, folder: Path, world: World | None) -> FurtherTask:
        """Return the task of a robot that starts somewhere, shape (n,), in a world."""
        own = self.task.task() if isinstance(self.task, TaskSpec) else self.task
        reference, part = None, self.part
        if own == POSTURE:
            if self.reference is not None:
                raise ShapeError("reference: a posture has none; give 'posture', where the joints are to be")
        else:
            tree = chain_as_tree(robot)
            own = tree.for_start(own, start)
            is_mass = own.kind == "center_of_mass"
            part = "position" if is_mass and part == "pose" else part
            if self.reference is not None:
                reference = self.reference.build(tree.pose_of(own, start), folder)
                if not is_mass:
                    reference = self.reference.of_robot(reference, tree.with_task(own), start, world)
        return FurtherTask(own, self.gain, reference, self.level, self.weight, part, self.posture)


class HandStart(Part, frozen=True, kw_only=True):
    """Where the end effector starts, inertial frame: inverse kinematics finds the configuration.

    Without ``quaternion`` and ``rpy`` the orientation does not matter.
    """

    position: Annotated[Vector, Meta(description="m")]
    quaternion: Annotated[Quaternion | None, Meta(description="scalar first")] = None
    rpy: Annotated[Vector | None, Meta(description="roll, pitch, yaw: Rz(y) Ry(p) Rx(r), rad")] = None

    def postures(self, robot: Robot) -> list[ReachingPosture]:
        """Return configurations that bring the end effector there, the best to start from first; see `robots.postures`.

        Raises
        ------
        ReachError
            If there is none.
        """
        rotation = rotation_from("start", self.quaternion, self.rpy)
        position = as_array("start.position", self.position, (3,))
        pose = algebra.pose((1.0, 0.0, 0.0, 0.0) if rotation is None else rotation, position)
        with error_prefix("start"):
            return postures(robot, pose, orientation=rotation is not None)


def start_configuration(
    given: Start,
    robot: Robot,
    field: str = "start",
    chosen: Callable[[list[ReachingPosture]], ReachingPosture] = itemgetter(0),
) -> Array:
    """Return a start configuration, shape (n,): as given, or one for a pose of the end effector, with a `NoteWarning`.

    ``chosen`` takes it from those that bring the end effector there; else it is the best.
    """
    if not isinstance(given, HandStart):
        return as_array(field, given, (robot.configuration_size,))
    best = chosen(given.postures(robot))
    rounded = np.round(best.q, 9) + 0.0  # of rounding, nothing
    numbers = ", ".join(
        f"{value:.4g}" if kind == "prismatic" else f"{math.degrees(value):.4g}°"
        for value, kind in zip(rounded, robot.joint_types, strict=True)
    )
    warnings.warn(f"{field}: [{numbers}], {best.room}", NoteWarning, stacklevel=2)
    return best.q


Start: TypeAlias = Annotated[list[float], Meta(min_length=1, description="rad or m")] | HandStart


class StartedRobotSpec(RobotSpec, frozen=True, kw_only=True):
    """A robot and where it starts."""

    start: Start

    def without_start(self) -> RobotSpec:
        """Return the robot alone."""
        return RobotSpec(**{name: getattr(self, name) for name in RobotSpec.__struct_fields__})


class Spec(Part, frozen=True, kw_only=True, dict=True):
    """An experiment: one reference; robots, laws with their parameters and plants, one or several of each; repeats.

    Parameters
    ----------
    name
        Names the folder of results.
    robot, start
        Name, file, or source with base and tip link; start configuration, one number a joint, rad or m, or the pose of
        the end effector, for which inverse kinematics finds one.
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
        What moves the end effector beside the commands; not for physics.
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
    null_space, constraints
        Of all laws that name none.
    tasks
        What two arms or another tree are to do beside the law's task.
    contact
        How the frame that laws follow gives way to the measured wrench; see `Admittance`.
    world
        What stands around the robots, by name; or the name of a file that says it.
    outcome
        What is to be true of each run; its verdict says whether it was.
    """

    name: Annotated[
        str,
        Meta(
            pattern=r"^(?!\.)[\w.-]{1,60}\Z",
            description="at most 60 letters, digits, _ . - and no dot first",
        ),
    ]
    robot: str | RobotSpec | UnsetType = UNSET
    start: Start | None = None
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
    tasks: Annotated[list[FurtherTaskSpec], Meta(min_length=1, max_length=20)] | None = None
    constraints: Constraints | None = None
    contact: Admittance | None = None
    world: Bodies | None = None
    outcome: Annotated[list[Expectation], Meta(min_length=1, max_length=50)] | None = None

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
        if not isinstance(self.robot, RobotSpec):
            return {"": StartedRobotSpec(source=str(self.robot), start=self.start)}
        return {"": StartedRobotSpec(**msgspec.structs.asdict(self.robot), start=self.start)}

    @property
    def law_by_label(self) -> dict[str, AnyLaw]:
        """All laws by label, without sets and grids; a single law's label is its kind."""
        return _by_label("law", self.law, self.laws)

    @property
    def plant_by_label(self) -> dict[str, AnyPlant]:
        """All plants by label; a single plant's label is its kind."""
        plants = _by_label("plant", self.plant, self.plants)
        world = self.surroundings
        return plants if world is None else {label: each.in_world(world) for label, each in plants.items()}

    @property
    def checked_outcome(self) -> list[Expectation]:
        """What is to be true of each run.

        Raises
        ------
        Error
            If one of it says nothing, or names a body that there is not.
        """
        found = self.outcome or []
        for k, each in enumerate(found):
            with error_prefix(f"outcome[{k}]"):
                each.check(self.surroundings)
        return found

    @cached_property
    def surroundings(self) -> World | None:
        """The world, if it says one."""
        return None if self.world is None else World(bodies=self.world)

    @property
    def with_empty_hands(self) -> Spec:
        """The same with nothing in the hand yet of what steps of its reference grip."""
        names = gripped_by_steps(self.reference)
        return msgspec.structs.replace(self, world=never_held(self.world or {}, names)) if names else self

    def gripping(self, steps: Sequence[GripperStep]) -> Spec:
        """Return the same with what hands hold, and grippers do, by steps of its reference."""
        if not steps:
            return self
        events = [GripperEvent(time=step.begin, closed=step.closes) for step in steps]

        def scheduled(plant: AnyPlant) -> AnyPlant:
            if (gripper := getattr(plant, "gripper", None)) is None:
                return plant
            return msgspec.structs.replace(plant, gripper=msgspec.structs.replace(gripper, schedule=events))

        one = self.plant if isinstance(self.plant, UnsetType) else scheduled(self.plant)
        several = self.plants
        if not isinstance(several, UnsetType):
            several = {label: scheduled(each) for label, each in several.items()}
        bodies = held_by_steps(self.world or {}, steps)
        return msgspec.structs.replace(self, world=bodies or None, plant=one, plants=several)

    def supervisor_of(self, plant: AnyPlant) -> Supervisor | None:
        """Return what stands before a plant, if anything."""
        if isinstance(self.supervisor, Supervisor):
            zones, world = self.supervisor.keep_out, self.surroundings
            if zones is None or world is None:
                return self.supervisor
            zones = msgspec.structs.replace(zones, world=world)
            return msgspec.structs.replace(self.supervisor, keep_out=zones)
        if plant.is_robot and self.supervisor is False:
            raise ValueRangeError("supervisor: a robot always has one; got false")
        wanted = plant.is_supervised if self.supervisor is None else self.supervisor
        return Supervisor() if wanted else None

    def prepared_tasks(self, robot: Robot, start: Array, folder: Path, times: Array) -> PreparedTasks | None:
        """Return what is to be done beside the law's task, made ready; None if nothing is.

        Parameters
        ----------
        robot, start
            Where it starts, shape (n,).
        folder
            That file names start from.
        times
            Of the samples, shape (N,), s.
        """
        if self.tasks is None:
            return None
        further = []
        for i, each in enumerate(self.tasks):
            with error_prefix(f"tasks[{i}]"):
                further.append(each.further_task(robot, start, folder, self.surroundings))
        return PreparedTasks(robot, further, start, times)

    def limits_of(self, plant: AnyPlant, robot: Robot) -> CommandLimits:
        """Return what is done to commands before a plant."""
        return limits_before(plant, self.limits, robot)

    @cached_property
    def variants(self) -> list[Variant[AnyLaw]]:
        """All laws with the parameters of their sets and grids, in the order that they run in."""
        laws = {label: self._completed(law) for label, law in self.law_by_label.items()}
        return variants(laws, self.parameter_sets, self.grids)

    def _completed(self, law: AnyLaw) -> AnyLaw:
        """Return a law with what the spec says of all laws."""
        missing = {
            key: getattr(self, key)
            for key in ("null_space", "constraints", "contact")
            if getattr(self, key) is not None and getattr(law, key) is None
        }
        law = msgspec.structs.replace(law, **missing) if missing else law
        if self.world is None or law.constraints is None:
            return law
        kept = msgspec.structs.replace(law.constraints, world=self.surroundings)
        return msgspec.structs.replace(law, constraints=kept)

    @property
    def keeps_records(self) -> bool:
        """Whether every sample is kept."""
        return self.repeats == 1 if self.record is None else self.record == "all"

    @property
    def may_cut(self) -> bool:
        """Whether its runs may end before their reference, and how long that is takes no plan to find out."""
        return self.duration is not None and not self.reference.plans_around

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


_OTHER_COMMANDS = {
    "sweep": ("a parameter study", "sweep"),
    "tune": ("a search for the best parameters", "tune"),
    "learn": ("learning from repetition", "learn"),
}


def read_spec(source: str | Path | dict[str, Any], leaving_out: Collection[str] = ()) -> tuple[Spec, Path]:
    """Return a spec and the folder that its relative file names start from.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary (file names are then relative to the working folder), in which
        robot, reference, laws and plants may be objects.
    leaving_out
        Blocks of other commands, as ``tune``, that are passed over.

    Raises
    ------
    FileFormatError
        If the file is missing, malformed, or has an unknown or unfit key: ``path: field: …``.
    """
    where, data, folder = read_data(source)
    for key in leaving_out:
        data.pop(key, None)
    for key, (what, command) in _OTHER_COMMANDS.items():
        if key in data:
            raise FileFormatError(f"{where}: {key}: describes {what}; run it with 'dqcontrol {command}'")
    return as_spec(where, data, folder), folder


def read_data(source: str | Path | dict[str, Any]) -> tuple[str, dict[str, Any], Path]:
    """Return the name, the plain data and the folder of a spec, not yet checked; see `read_spec`."""
    if not isinstance(source, str | Path | dict):
        raise ShapeError(f"spec: expected the path of a YAML file or a dictionary, got {source!r:.80}")
    if isinstance(source, dict):
        where, folder = "spec", Path.cwd()
        try:
            data = msgspec.to_builtins(_without_objects(source), enc_hook=_plain)
        except (TypeError, NotImplementedError) as error:
            raise FileFormatError(f"{where}: {error}") from None
    else:
        where, folder = str(source), Path(source).resolve().parent
        data = parse_yaml(where, read_text(where))
    if not isinstance(data, dict):
        glued = "; put a space after each colon" if isinstance(data, str) and ":" in data else ""
        raise FileFormatError(
            f"{where}: is empty or no mapping; it needs name, robot, start, period, reference, law, plant{glued}"
        )
    if not isinstance(source, dict):
        use_copies(data, folder)
    return where, data, folder


def as_spec(where: str, data: dict[str, Any], folder: Path) -> Spec:
    """Return plain data as a spec; ``where`` is for the messages."""
    spec = convert(where, in_numbers(where, data, folder), Spec)
    for check in ("robot_by_label", "plant_by_label", "variants", "checked_outcome"):
        try:
            getattr(spec, check)
        except Error as error:
            raise FileFormatError(f"{where}: {error}") from None
    return spec


def in_numbers(where: str, data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return plain data with what files say in their place, and with numbers in SI units for texts like ``60 mm``."""
    complete_plants(data, folder)
    if "world" in data:
        try:
            data["world"] = said_world(data["world"], folder)
        except FileFormatError as error:
            if isinstance(data["world"], str):
                raise FileFormatError(f"{where}: world: {error}") from None
            raise
    admit(where, data, folder)
    data = numbers_for_quantities(where, data, list(kinds_of(Spec)))
    changed = [(f"grids.{law}", keys) for law, keys in _items(data.get("grids"))]
    for name, laws in _items(data.get("parameter_sets")):
        changed += [(f"parameter_sets.{name}.{law}", keys) for law, keys in _items(laws)]
    for field, keys in changed:
        for key, value in _items(keys):
            keys[key] = quantities_at(where, f"law.{key}", value, f"{field}.{key}")
    return data


def part_of_spec(where: str, text: str, key: str) -> Any:
    """Return a ``law`` or ``plant``, ``key``, as a spec writes it in one line, or by its kind alone.

    ``where`` is for the messages.

    Raises
    ------
    FileFormatError
        If it is malformed, or there is no such kind.

    Examples
    --------
    >>> part_of_spec("--law", "{kind: proportional, gain: 5}", "law").gain
    5.0
    """
    given = parse_yaml(where, text)
    data = {key: {"kind": given} if isinstance(given, str) else given}
    complete_plants(data, Path.cwd())
    admit(where, data, Path.cwd())
    data = numbers_for_quantities(where, data, list(kinds_of(Spec)))
    return convert(where, data[key], AnyLaw if key == "law" else AnyPlant)


def quantities_at(where: str, key: str, values: Any, field: str) -> Any:
    """Return what a key of a spec may be, one value or a list of them, with numbers in SI units for ``60 mm``."""
    kinds = kinds_below(list(kinds_of(Spec)), key)
    if isinstance(values, list):
        return [numbers_for_quantities(where, each, kinds, f"{field}[{i}]") for i, each in enumerate(values)]
    return numbers_for_quantities(where, values, kinds, field)


def readable_again(key: str, value: Any) -> Any:
    """Return a value, in SI units, of a key of a spec with its unit where a spec has to say it."""
    return quantities_for_numbers(value, kinds_below(list(kinds_of(Spec)), key), key)


def _items(mapping: Any) -> list[tuple[str, Any]]:
    """Return the entries of what should be a mapping; `convert` refuses what is none."""
    return list(mapping.items()) if isinstance(mapping, dict) else []


def _without_objects(source: dict[str, Any]) -> dict[str, Any]:
    """Return a spec with plain data for robots and references that are objects; laws and plants are data already."""
    out = dict(source)
    if isinstance(out.get("robot"), Robot):
        out["robot"] = _robot_data(out["robot"])
    for label, given in _items(out.get("robots")):
        if isinstance(given, dict) and isinstance(given.get("source"), Robot):
            rest = {key: value for key, value in given.items() if key != "source"}
            out["robots"] = out["robots"] | {label: rest | _robot_data(given["source"])}
    if isinstance(out.get("reference"), Reference):
        out["reference"] = reference_data(out["reference"])
    return out


def _robot_data(robot: Robot) -> dict[str, Any]:
    """Return what a spec says of a robot that was loaded, or of an arm that was made in Python."""
    if robot.origin is not None:
        data: dict[str, Any] = dict(zip(("source", "base_link", "tip_link"), robot.origin, strict=True))
        if not isinstance(robot, TreeRobot):
            return data
        task = robot.task
        if not isinstance(robot, TwoArms):
            data["tips"] = list(robot.tips) or "all"
        return {**data, "task": {"kind": task.kind, "frames": list(task.frames), "root": task.root}}
    if not isinstance(robot, SerialArm):
        raise FileFormatError(
            f"robot: {robot!r} was made in Python; write it as a file with 'parts' "
            "(two arms: with 'left' and 'right') for a spec"
        )
    return {"model": plain_arm(robot)}


def _plain(value: Any) -> Any:
    """Return NumPy's arrays and numbers, paths and functions as what a YAML file would give."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    if callable(value):
        return place_of(value)
    raise TypeError(f"cannot hold {value!r:.80}")


_fields = cache(msgspec.structs.fields)  # which evaluates a class's annotations anew each time


def _written(value: Any) -> Any:
    """Return a part of a spec as plain data with its defaults, without keys that say nothing."""
    if isinstance(value, msgspec.Struct):
        config = type(value).__struct_config__
        out = {config.tag_field: config.tag} if config.tag_field else {}
        for each in _fields(type(value)):
            content = getattr(value, each.name)
            if content is UNSET or (content is None and each.default is None):
                continue
            if (plain := _written(content)) or not isinstance(content, msgspec.Struct):
                out[each.encode_name] = plain
        return out
    if isinstance(value, dict):
        return {key: _written(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_written(each) for each in value]
    return msgspec.to_builtins(value, enc_hook=_plain)


def _drop_copies(data: dict[str, Any]) -> None:
    """Take the world out of what was given it: laws' constraints, plants, and what a supervisor keeps out of."""
    for key, inner in (("law", "constraints"), ("plant", None), ("supervisor", "keep_out")):
        for part in (data.get(key), *(data.get(f"{key}s") or {}).values()):
            found = part.get(inner) if isinstance(part, dict) and inner else part
            if isinstance(found, dict):
                found.pop("world", None)


def spec_text(spec: Spec, folder: Path) -> str:
    """Return the YAML of a spec with all defaults and absolute file names, so that it runs anywhere."""
    plain = _written(spec)
    if spec.world is not None:
        _drop_copies(plain)
    data = quantities_for_numbers(plain, list(kinds_of(Spec)))
    locate_files(data, folder)
    return yaml_text(data)
