"""A spec made ready: everything it names loaded, checked and prepared before anything moves."""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Callable, Collection, Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
import numpy as np
from msgspec import UNSET

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.compiled.kernel_cache import has_source, source_hash
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.controller import Controller, PreparedTasks
from dqcontrol.errors import (
    Error,
    LimitWarning,
    ReachError,
    ShapeError,
    ValueRangeError,
    error_prefix,
)
from dqcontrol.experiments.contact_check import check_contact
from dqcontrol.experiments.contacts import check_floor
from dqcontrol.experiments.parameter_units import note_turns, suspected_degrees, suspected_millimetres
from dqcontrol.experiments.results_folder import folder_names
from dqcontrol.experiments.spec import (
    AnyLaw,
    AnyPlant,
    Spec,
    Start,
    StartedRobotSpec,
    read_spec,
    spec_text,
    start_configuration,
)
from dqcontrol.experiments.spec.parameter_sets import Variant
from dqcontrol.extensions import user_code
from dqcontrol.files.long_array import row_by_row
from dqcontrol.laws import Law, Posture
from dqcontrol.limits import CommandLimits
from dqcontrol.loop.closed_loop import FARTHEST, check_disturbed
from dqcontrol.loop.simulate import step_count
from dqcontrol.measures.run_numbers import DesiredMotion
from dqcontrol.measures.stability import LoopGain, loop_gains
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.planning.followed_path import start_through
from dqcontrol.plants.plant import lagging_mode, running_plant
from dqcontrol.references import POSE, TIME, Previewed, Reference
from dqcontrol.references.set_points import GripperStep
from dqcontrol.robots import ReachingPosture, Robot, TreeRobot, WholeBody, describe
from dqcontrol.robots.kinematics.kinematics_kernels import split
from dqcontrol.robots.robot import Lag, base_coordinates
from dqcontrol.robots.whole_body import Base, parts_with_offsets

_POSES = 200  # of the reference, evenly spaced
_RESTARTS = 100  # of a search that ends with the first that is found
_POSITION, _ORIENTATION = 1e-3, 1e-2  # m, rad: nearer than that is reached


def check_reach(robot: Robot, start: Array, samples: Array, *, orientation: bool = True) -> None:
    """Raise if a reference leaves what the robot can reach; warn if it leaves what it can within its joint limits.

    First the distance from the first axis is held against the length of the stretched arm, unless it stands on a base
    that drives; then poses along the reference are solved for. Each can be reached by itself then; whether without a
    jump between them, and by driving as a base can, is for the run to show. A robot whose end effector cannot move in
    all six directions cannot reach most poses exactly: only positions count there.

    Parameters
    ----------
    robot
        The arm or whole body.
    start
        Start configuration, shape (n,).
    samples
        Desired motion, shape (N, 21), inertial frame.
    orientation
        Whether that counts.

    Raises
    ------
    ReachError
        With the time and the distance missing.
    """
    drives = bool(base_coordinates(robot).any())
    if not drives and robot.joint_types[0] == "revolute" and not isinstance(robot, TreeRobot):
        _check_length(robot, samples)
    chosen = samples[np.unique(np.linspace(0, len(samples) - 1, _POSES).astype(int))]
    found = robot.solve(
        chosen[:, POSE],
        _driven_near(robot, start, chosen[:, POSE]) if drives else start,
        position_tolerance=_POSITION,
        orientation_tolerance=_ORIENTATION if orientation and _turns_freely(robot) else np.inf,
        restarts=_RESTARTS,
    )
    for i in [i for i, reason in enumerate(found.reason) if reason.startswith("unreachable")]:
        raise ReachError(
            f"reference: at t = {chosen[i, TIME]:.3g} s the desired pose is out of reach of {robot.name}: "
            f"{found.reason[i].partition(': ')[2]}"
        )
    for i in [i for i, reason in enumerate(found.reason) if reason.startswith("limits")][:1]:
        warnings.warn(
            f"reference: at t = {chosen[i, TIME]:.3g} s the desired pose needs {robot.name} beyond its "
            f"{found.reason[i]}",
            LimitWarning,
            stacklevel=4,
        )


def _check_length(robot: Robot, samples: Array) -> None:
    """Raise if a position is farther from the first axis than the stretched arm is long."""
    shoulder = _shoulder(robot)
    distance = row_by_row(
        lambda rows: np.linalg.norm(algebra.translation(rows[:, POSE]) - shoulder, axis=1), samples
    )
    far = distance - describe(robot).reach
    if far.max() > _POSITION:
        raise ReachError(
            f"reference: at t = {samples[int(far.argmax()), TIME]:.3g} s the desired position is {far.max():.3g} m "
            f"out of reach of {robot.name}"
        )


def _driven_near(robot: Robot, start: Array, poses: Array) -> Array:
    """Return the start for each pose, a base that stands on the floor driven as far as the end effector has to go."""
    starts = np.tile(start, (len(poses), 1))
    first = next(parts_with_offsets(robot.parts))[0] if isinstance(robot, WholeBody) else 0
    if base_coordinates(robot)[first]:
        way = algebra.translation(poses) - algebra.translation(robot.fkm(start))
        starts[:, first : first + 2] += way[:, :2]
    return starts


def _turns_freely(robot: Robot) -> bool:
    """Return whether the end effector can move in all six directions in general; drives stand as they need."""
    free = robot.in_form("unconstrained") if isinstance(robot, WholeBody) else robot
    q = np.random.default_rng(0).uniform(-1.0, 1.0, robot.configuration_size)
    room = np.empty(8 + 14 * free.input_size)
    free.kernels.twist_kinematics(free.table, q, room)  # of all its kernels the one that the run needs, too
    _, _, jacobian = split(room)
    return bool(np.linalg.matrix_rank(jacobian, tol=1e-6) == 6)


def _shoulder(robot: Robot) -> Array:
    """Return the point of the first axis nearest to the next joint, from which the reach is measured."""
    w, x, y, z = robot.chain[0, :4]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    return robot.chain[0, 4:7] + robot.chain[1, 6] * axis


T = TypeVar("T")

_KEPT_BYTES = 200e6  # of prepared laws; beyond that they are prepared again when their turn comes
_MOST_TRIALS = 10_000_000  # more are a slip
_FEW_CASES = 100  # whose laws a point keeps ready, 10 kB each
_MOST_KNOWN = 16  # robots and scenes
FULL_POSE = 6  # joints, with fewer of which an end effector follows no pose
PATH_SAMPLES = 200  # of a path that starts are tried with: 20 mm apart on one of 4 m


@dataclass(frozen=True)
class PreparedRobot:
    """A robot where it starts, and the motion that it is to follow, sampled.

    What is ``desired`` is that of the first motion: of one that is led in time it is the same.
    """

    robot: Robot
    start: Array
    reference: Reference
    samples: Array
    desired: DesiredMotion
    tasks: PreparedTasks | None = None

    def as_followed(self, law: Law, lag: Lag) -> PreparedRobot:
        """Return it as a law is given it to follow with joints that are late.

        Twists lead by lag and delay of the joints, and by half of a period, if the law feeds forward to second order
        and the spec does not say itself by how much they do.
        """
        times, delays = lag.mean
        if not law.lag_at or not times + delays or isinstance(self.reference, Previewed):
            return self
        period = float(self.samples[1, TIME] - self.samples[0, TIME])
        return self.along(Previewed(self.reference, delays + period / 2, times, period))

    def along(self, reference: Reference) -> PreparedRobot:
        """Return the same with another reference, at the same times."""
        times = np.ascontiguousarray(self.samples[:, TIME])
        return replace(self, reference=reference, samples=reference.samples(times))


class Names(NamedTuple):
    """Labels of one combination of robot, law, parameter set and plant; empty where there is but one."""

    robot: str
    law: str
    set: str
    plant: str

    @property
    def label(self) -> str:
        """Those that are not empty, in one text."""
        return " · ".join(name for name in self if name)


@dataclass(frozen=True)
class Combination:
    """One combination of robot, law, parameter set and plant.

    Attributes
    ----------
    names, scene, variant, plant
        What is combined.
    limits
        What is done to the commands before they leave.
    is_compiled
        Whether the whole loop is.
    prepared
        The law ready to run, if it was kept.
    lag
        How late the plant's joints are.
    """

    names: Names
    scene: PreparedRobot
    variant: Variant[AnyLaw]
    plant: AnyPlant
    limits: CommandLimits
    is_compiled: bool
    prepared: Controller | None
    gains: tuple[LoopGain, ...] | None
    lag: Lag

    def prepare_law(self, spec: Spec) -> Controller:
        """Return the law ready to run, prepared when the spec was checked or now."""
        if self.prepared is not None and not self.prepared.depends_on_mode:
            return self.prepared
        scene, mode = self.scene, lagging_mode(self.plant)
        if self.prepared is not None:
            return self.prepared.in_mode(mode, self.lag)
        return self.variant.law.prepare(
            scene.robot, scene.reference, spec.period, self.limits, mode, scene.tasks, self.lag
        )


@dataclass(frozen=True)
class PreparedExperiment:
    """A spec, the folder of its relative file names, and all that it combines, in the order that it runs in."""

    spec: Spec
    folder: Path
    scenes: dict[str, PreparedRobot]
    cases: tuple[Combination, ...]

    def with_drives_of(self, spec: Spec) -> PreparedExperiment:
        """Return the same for a spec that differs in its laws and plants alone, for runs that follow at once.

        Its robots and what they follow stay; plants are left to the runs, as of a spec that is not checked.
        """
        return _combined(spec.with_empty_hands, self.folder, self.scenes, checked=False)

    @property
    def scene(self) -> PreparedRobot:
        """The first robot's."""
        return next(iter(self.scenes.values()))

    def only_case(self, source: object, otherwise: str) -> Combination:
        """Return the case of a spec of one run; ``otherwise`` says why there may not be several."""
        if not self.spec.is_single:
            raise ShapeError(f"{source}: describes several runs ({self.spec.several}); {otherwise}")
        return self.cases[0]

    @property
    def text(self) -> str:
        """The spec as YAML with all defaults."""
        return spec_text(self.spec, self.folder)

    def single_text(self, case: Combination, repeat: int) -> str:
        """Return the spec of one trial as YAML."""
        chosen = self.spec.robot_by_label[case.names.robot]
        robot = self.spec.robot if self.spec.robots is UNSET else chosen.without_start()
        one = msgspec.structs.replace(
            self.spec,
            robot=robot,
            start=case.scene.start.tolist(),
            robots=UNSET,
            law=case.variant.law,
            laws=UNSET,
            parameter_sets=None,
            grids=None,
            plant=case.plant,
            plants=UNSET,
            limits=case.limits,
            repeats=1,
            seed=self.spec.seed + repeat,
            record=None,
        )
        return spec_text(one, self.folder)

    def fingerprint(self) -> str:
        """Return a hash of what trials depend on beside the spec's text: the files that it names, and this program."""
        digest = hashlib.sha256(program().encode())
        for scene in self.scenes.values():
            robot = scene.robot
            limits = [robot.limits.lower, robot.limits.upper, robot.limits.velocity, robot.limits.effort]
            masses = [robot.inertia.mass, robot.inertia.center, robot.inertia.tensor] if robot.inertia else []
            tasks = [scene.tasks.parameters] if scene.tasks else []
            for array in (robot.chain, robot.table, *limits, *masses, scene.samples, *tasks):
                digest.update(np.ascontiguousarray(array).data)
            digest.update(repr((robot.joint_names, _bases(robot))).encode())
        for content in user_code.sources(msgspec.to_builtins(self.spec)):
            digest.update(content)
        kinds = {type(kind).__module__ for case in self.cases for kind in (case.variant.law, case.plant)}
        for module in sorted(kinds):  # `program` counts this package; these may be of others
            if module.partition(".")[0] != "dqcontrol" and has_source(module):
                digest.update(source_hash(module, lazily=True).encode())
        for plant in self.spec.plant_by_label.values():
            for file in plant.files():
                digest.update(file.read_bytes())
        return digest.hexdigest()


def _bases(robot: Robot) -> list[object]:
    """Return the mobile bases of a robot, with wheels, limits and chassis; their ``repr`` says all of it."""
    parts = robot.parts if isinstance(robot, WholeBody) else ()
    return [part for part in parts if isinstance(part, Base)]


def sources() -> str:
    """Return a hash of the sources that results of trials depend on; pictures and pages are not among them."""
    return source_hash("dqcontrol.experiments.trials", lazily=True)


def program() -> str:
    """Return a hash of this program, and the versions of the libraries that draw the noise and move the joints."""
    found = [sources()]
    for name in ("numpy", "mujoco"):
        with suppress(PackageNotFoundError):
            found.append(f"{name} {version(name)}")
    return " ".join(found)


def check_program(expected: str) -> None:
    """Raise if this worker has another version of the program or its libraries than who sent it work."""
    if program() != expected:
        raise Error("a worker has another version of dqcontrol, NumPy or MuJoCo; give all the same")


def prepare(source: str | Path | dict[str, Any], leaving_out: Collection[str] = ()) -> PreparedExperiment:
    """Load everything that a spec names and check that it fits together, before anything moves; see `read_spec`.

    Raises
    ------
    Error
        If something is missing, malformed, does not fit or is out of reach.
    """
    spec, folder = read_spec(source, leaving_out)
    with nullcontext() if isinstance(source, dict) else error_prefix(str(source)):
        return prepare_spec(spec, folder, {})


def prepare_spec(
    spec: Spec, folder: Path, known: dict[bytes, Any], *, checked: bool = True
) -> PreparedExperiment:
    """Do the same for a spec that was read.

    Parameters
    ----------
    spec, folder
        What was read, and where.
    known
        Robots and scenes from earlier calls, which are not made again.
    checked
        False: plants are started, and laws prepared if there are many, by the runs alone, which follow at once; gains
        are not worked out.
        What constraints keep is checked all the same: a run does not ask whether its start keeps it.
    """
    spec = spec.with_empty_hands
    variants, plants = spec.variants, spec.plant_by_label
    robots = spec.robot_by_label
    trials = len(robots) * len(variants) * len(plants) * spec.repeats
    if trials > _MOST_TRIALS:
        raise ShapeError(f"spec: describes {trials:,} trials; at most {_MOST_TRIALS:,}")
    every = product(robots, plants, variants)
    folder_names(Names(robot, each.label, each.set, plant).label for robot, plant, each in every)
    scenes = {}
    for label, robot in robots.items():
        with error_prefix(f"robots.{label}") if label else nullcontext():
            parts = spec.reference, spec.period, spec.duration, spec.skip_initial, robot, spec.tasks
            if spec.reference.plans_around:
                parts = *parts, [each.law.constraints for each in variants], list(plants.values()), spec.world
            scenes[label] = _once(known, parts, lambda chosen=robot: _scene(spec, chosen, folder, known))
    return _combined(spec, folder, scenes, checked=checked)


def _combined(
    spec: Spec, folder: Path, scenes: dict[str, PreparedRobot], *, checked: bool
) -> PreparedExperiment:
    """Return a spec whose robots are made ready with all that it combines them with; see `prepare_spec`."""
    spec, cases = spec.gripping(_gripper_steps(scenes)), []
    variants, plants = spec.variants, spec.plant_by_label
    for label, started in scenes.items():
        with error_prefix(f"robots.{label}") if label else nullcontext():
            limits = {name: spec.limits_of(plant, started.robot) for name, plant in plants.items()}
            different = {each.velocity: each for each in limits.values()}
            laws = [(dict.fromkeys(different), None)] * len(variants)
            compiled = dict.fromkeys(plants, False)
            if checked or any(variant.law.constraints for variant in variants):
                laws = list(_prepared_laws(spec, variants, started, different))
                compiled = _checked_plants(spec, plants, started)
        led: dict[bytes, PreparedRobot] = {}
        for name, plant in plants.items():
            for variant, (versions, gains) in zip(variants, laws, strict=True):
                place = Names(label, variant.label, variant.set, name)
                law, lag = versions[limits[name].velocity], plant.lag(started.robot)
                follow = partial(started.as_followed, variant.law, lag)
                scene = _once(led, [bool(variant.law.lag_at), lag.mean], follow)
                if scene is not started:  # the law's rows may depend on the twists: it is prepared again
                    law = None
                cases.append(
                    Combination(place, scene, variant, plant, limits[name], compiled[name], law, gains, lag)
                )
    if checked:
        for case in cases:
            check_contact(spec, case)
    elif len(cases) <= _FEW_CASES:
        cases = [replace(case, prepared=case.prepare_law(spec)) for case in cases]
    return PreparedExperiment(spec, folder, scenes, tuple(cases))


def _gripper_steps(scenes: dict[str, PreparedRobot]) -> tuple[GripperStep, ...]:
    """Return when grippers close and open, which is the same for all robots."""
    with error_prefix("reference"):
        found = {label: scene.reference.gripper_steps for label, scene in scenes.items()}
    first = next(iter(found.values()))
    for label, steps in found.items():
        if [each[:4] for each in steps] != [each[:4] for each in first]:
            raise ShapeError(
                f"reference: robots {next(iter(found))} and {label} grip at different times; give each its own spec"
            )
    return first


def _once(known: dict[bytes, Any], key: object, make: Callable[[], T]) -> T:
    """Return what is known under a key, or make it; all is forgotten when it becomes too much."""
    text = msgspec.json.encode(key)
    if text not in known:
        if len(known) >= _MOST_KNOWN:
            known.clear()
        known[text] = make()
    return known[text]


def _scene(spec: Spec, chosen: StartedRobotSpec, folder: Path, known: dict[bytes, Any]) -> PreparedRobot:
    robot = _once(known, [str(folder), chosen.without_start()], lambda: chosen.load(folder))
    start = _start(chosen.start, robot, partial(_through_all, spec, folder, robot))
    robot = robot.from_start(start)
    reference = spec.reference.build(robot.fkm(start), folder)
    kept = _kept(spec, robot) if spec.reference.plans_around else None
    with error_prefix("reference") if kept else nullcontext():
        reference = spec.reference.of_robot(reference, _widest(spec, robot), start, spec.surroundings, kept)
    times = spec.period * np.arange(step_count(reference, spec.period, spec.duration), dtype=np.float64)
    samples = reference.samples(times)
    if spec.skip_initial > samples[-1, -1]:
        raise ValueRangeError(
            f"skip_initial: must be ≤ the run's {samples[-1, -1]:g} s, got {spec.skip_initial:g}"
        )
    try:
        check_reach(robot, start, samples)
    except ReachError as error:
        if not getattr(reference, "streamed", False):  # what an end effector leads may well go out of reach
            raise ReachError(f"{error}{suspected_millimetres(spec.reference, robot)}") from None
        warnings.warn(str(error), LimitWarning, stacklevel=2)
    check_floor(robot, start, samples)
    tasks = _tasks(spec, robot, start, folder, times)
    return PreparedRobot(robot, start, reference, samples, DesiredMotion.of(samples), tasks)


def _kept(spec: Spec, robot: Robot) -> PreparedConstraints:
    """Return what all laws of a spec keep, as its plant with the most lag needs it; else all bodies of its world."""
    given = [variant.law.constraints for variant in spec.variants]
    if any(each != given[0] for each in given):
        raise ShapeError(
            f"reference: {spec.reference.__struct_config__.tag} plans once for all laws, and these keep different "
            "constraints; give them once, as 'constraints' of the spec"
        )
    world = spec.surroundings
    asked = given[0] or Constraints(world=world, clear_of="all" if world else None)
    found = [
        asked.prepare(robot, spec.period, lagging_mode(plant), plant.lag(robot))
        for plant in spec.plant_by_label.values()
    ]
    return max(found, key=lambda each: float(each.allowances.sum()))


def _widest(spec: Spec, robot: Robot) -> Robot:
    """Return a robot with the widest of its own base and those on which its plants put it."""
    for plant in spec.plant_by_label.values():
        robot = plant.body_of(robot)
    return robot


def _tasks(spec: Spec, robot: Robot, start: Array, folder: Path, times: Array) -> PreparedTasks | None:
    """Return what is to be done beside the law's task; raise if a task's reference is out of reach."""
    tasks = spec.prepared_tasks(robot, start, folder, times)
    if tasks is None:
        return None
    for i, (task, samples, part) in enumerate(zip(tasks.tasks, tasks.samples, tasks.parts, strict=True)):
        if task is not None and task.kind != "center_of_mass" and part in ("pose", "position"):
            with error_prefix(f"tasks[{i}]"):
                check_reach(tasks.robot.with_task(task), start, samples, orientation=part == "pose")
    return tasks


def _through_all(spec: Spec, folder: Path, robot: Robot, found: list[ReachingPosture]) -> ReachingPosture:
    """Return the best posture from which the whole reference is followed and constraints are kept, or the best."""
    given = [variant.law.constraints for variant in spec.variants]
    if any(each != given[0] for each in given) or robot.configuration_size < FULL_POSE or len(robot.drives):
        return found[0]
    asked = given[0] or Constraints(self_collision=False)
    paths = []
    for each in found:
        reference = spec.reference.build(robot.fkm(each.q), folder)
        goes = 0.0 if math.isinf(reference.duration) else reference.duration
        times = np.linspace(0.0, goes, PATH_SAMPLES if goes else 1)
        paths.append((each.q, reference.samples(times)[:, POSE]))
    start = start_through(paths, CertifiedEdges(robot, asked), aside=given[0] is not None)
    return next(each for each in found if np.array_equal(each.q, start))


def _start(given: Start, robot: Robot, chosen: Callable[[list[ReachingPosture]], ReachingPosture]) -> Array:
    """Return the start configuration, within the limits."""
    start = start_configuration(given, robot, chosen=chosen)
    if (far := np.abs(start) > FARTHEST).any():
        i = int(far.argmax())
        raise ValueRangeError(
            f"start: {robot.joint_names[i]} is {start[i]:g}; at most {FARTHEST:g} rad or m, no robot goes farther"
        )
    outside = (start < robot.limits.lower) | (start > robot.limits.upper)
    if outside.any():
        i = int(outside.argmax())
        raise ValueRangeError(
            f"start: {robot.joint_names[i]} is {start[i]:g}, outside its limits "
            f"{robot.limits.lower[i]:.4g} … {robot.limits.upper[i]:.4g}{suspected_degrees(start, robot)}"
        )
    note_turns("start", start, robot)
    return start


def _prepared_laws(
    spec: Spec,
    variants: list[Variant[AnyLaw]],
    scene: PreparedRobot,
    different: dict[bool | None, CommandLimits],
) -> Iterator[tuple[dict[bool | None, Controller | None], tuple[LoopGain, ...] | None]]:
    """Prepare every law, with different limits; give those that fit into memory, and the loop gains of all."""
    bytes_left = _KEPT_BYTES
    for variant in variants:
        with error_prefix(f"law {variant.label}" + (f", set {variant.set}" if variant.set else "")):
            limits = next(iter(different.values()))
            first = variant.law.prepare(scene.robot, scene.reference, spec.period, limits, tasks=scene.tasks)
            if isinstance(variant.law.null_space, Posture) and variant.law.null_space.rest is not None:
                note_turns("null_space.rest", np.array(variant.law.null_space.rest), scene.robot)
            if first.constraints:
                first.constraints.check_start(scene.start)
        bytes_left -= len(different) * first.parameters.nbytes
        kept = {
            velocity: (first.with_limits(limits) if i else first) if bytes_left > 0 else None
            for i, (velocity, limits) in enumerate(different.items())
        }
        yield kept, loop_gains(variant.law, first)


def _checked_plants(spec: Spec, plants: dict[str, AnyPlant], scene: PreparedRobot) -> dict[str, bool]:
    """Check that every plant can start, and tell which are compiled."""
    compiled = {}
    for label, plant in plants.items():
        if supervisor := spec.supervisor_of(plant):
            supervisor.prepare(scene.robot, spec.period).start(scene.start)
        if plant.is_robot:
            if spec.disturbance is not None:
                raise ValueRangeError("disturbance: only simulated joints can be moved so; leave it out")
            compiled[label] = False
            continue
        with error_prefix(f"plant {label}"):
            live = running_plant(plant.start(scene.robot, scene.start, spec.period, 1, spec.seed))
            if spec.disturbance is not None:
                check_disturbed(live)
        compiled[label] = live.compiled() is not None
    if spec.disturbance is not None:
        spec.disturbance.start(scene.robot, spec.period, 1, spec.seed)
    return compiled
