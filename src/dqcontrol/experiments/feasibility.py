"""Feasibility of a motion for a robot: the errors that remain, and the speeds that its joints need."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from dqcontrol import algebra, laws
from dqcontrol.arrays import Array
from dqcontrol.controller import Controller
from dqcontrol.errors import DivergedError
from dqcontrol.experiments.prepared_experiment import (
    FULL_POSE,
    PATH_SAMPLES,
    Combination,
    PreparedExperiment,
    PreparedRobot,
)
from dqcontrol.limits import CommandLimits
from dqcontrol.loop.simulate import simulate_prepared
from dqcontrol.measures.run_numbers import run_numbers
from dqcontrol.measures.task_range import inverse_of, lost_share
from dqcontrol.measures.task_result import FOLLOWED, SETTLED, TaskResult, task_result
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.planning.followed_path import continued
from dqcontrol.planning.standing_world import standing
from dqcontrol.plants import Integrator
from dqcontrol.plants.plant import command_mode
from dqcontrol.references import Sample
from dqcontrol.references.drive_to import DriveTo, PlannedWay
from dqcontrol.references.sample import POSE, TIME, TWIST, TWIST_RATE
from dqcontrol.robots import Robot
from dqcontrol.robots.robot import base_coordinates
from dqcontrol.tables.number_texts import percent_text

_MOST = 50_000  # samples of the reference that are followed; longer ones in coarser steps
_PULL = 0.2  # of an error that a period takes away
_ARRIVED = 50  # periods after which only what cannot be done is left of the first error: 0.8^50 = 1e-5
_SHARES = 1 + 1e-6
_ERROR = 1e-3  # of a dual quaternion: smaller ones have no direction that counts
_NONE = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])
_HAND_SPEED, _BALL = 0.25, 0.05  # m/s, m: an example of how much the lag of joints takes
_DETOUR = 1.5  # times the straight line: a way around a single thing is shorter
_FAR = 2.0  # m; farther than arms on a fixed base reach
_ALL = 1 - 1e-6  # of an error: what is left of it leads out by itself


@dataclass(frozen=True)
class PathDemand:
    """What a reference asks of a robot with ideal joints, without any limits, that follow it as well as can be.

    Attributes
    ----------
    left
        What the end effector misses all the same.
    peak_share
        Largest joint speed over its limit; NaN without limits.
    joint
        Whose it is.
    time
        When, s.
    limit_margin
        Least distance of a joint from its position limits, rad or m, negative beyond them; infinite without limits.
    """

    left: TaskResult
    peak_share: float
    joint: str
    time: float
    limit_margin: float


def path_demand(scene: PreparedRobot) -> PathDemand | None:
    """Return what a reference asks of a robot; None if the motion that follows it diverges.

    The motion is followed with feed-forward from the configuration nearest to its first pose, so no transient of a
    law counts; a plan in its own configurations. Bases with wheels, which cannot go sideways, follow it with their
    headings as they turn out and with the best ones; what leaves less counts.
    """
    samples = scene.samples[:: -(-len(scene.samples) // _MOST)]
    period = float(samples[1, -1] - samples[0, -1]) if len(samples) > 1 else 1.0
    gain, way = _PULL / period, scene.reference
    if isinstance(way, PlannedWay):
        law = laws.GuidedProportional(gain=gain).prepare(way.robot, way, period)
        return _demand(way.robot, law, scene.start, samples)
    robot = scene.robot.in_form("constrained")
    start = robot.solve(samples[0, POSE], scene.start, restarts=20).q
    held = np.repeat(samples[:1], _ARRIVED, axis=0)  # the first pose, until what can be reached of it is
    held[:, 8:20] = 0.0
    held[:, -1] = samples[0, -1] + period * np.arange(-_ARRIVED, 0)
    demands: list[PathDemand] = []
    for heading in (None, laws.BestHeading())[: 1 + bool(len(robot.drives))]:
        law = laws.ProportionalFeedforward(gain=gain, null_space=heading).prepare(robot, None, period)
        with suppress(DivergedError):
            arrived = simulate_prepared(law, Integrator(), start, held).q[-1]
            if (demand := _demand(robot, law, arrived, samples)) is not None:
                demands.append(demand)
    return min(demands, key=lambda demand: (not demand.left.succeeded, demand.left.position), default=None)


def _demand(robot: Robot, law: Controller, start: Array, samples: Array) -> PathDemand | None:
    try:
        record = simulate_prepared(law, Integrator(), start, samples)
    except DivergedError:
        return None
    if not np.isfinite(record.q).all():
        return None
    speeds = np.abs(record.command[:-1]) / robot.limits.velocity
    numbers = run_numbers(record, robot.limits)
    left, margin = task_result(record, numbers=numbers), numbers["limit_margin"]
    if not np.isfinite(robot.limits.velocity).any() or not len(speeds):
        return PathDemand(left, float("nan"), "", 0.0, margin)
    k, joint = np.unravel_index(int(speeds.argmax()), speeds.shape)
    return PathDemand(left, float(speeds[k, joint]), robot.input_names[joint], float(samples[k, -1]), margin)


def task_remarks(setting: PreparedExperiment) -> Iterator[str]:
    """Give what speaks against each robot's doing what is asked, and what helps, in a line each."""
    whole = [case for case in setting.cases if not isinstance(case.variant.law, laws.PartialProportional)]
    for label, scene in setting.scenes.items():
        if any(case.names.robot == label for case in whole):
            yield from _of_path(scene)
    for case in setting.cases:
        yield from _of_singular_start(case)
        yield from _of_first_command(setting, case)
        yield from _of_constraints(setting, case)
        yield from _of_way(case)
        yield from _of_rolling(setting, case)
    yield from run_remarks(setting)


def _of_way(case: Combination) -> Iterator[str]:
    """Say what stands in the way: of joints that go straight to a set-point, or of a path of the end effector."""
    given, scene = case.variant.law.constraints, case.scene
    robot, start = scene.robot, scene.start
    if given is None or len(robot.drives) or isinstance(scene.reference, PlannedWay):
        return
    if standing(given) is not given:
        return  # what moves may be elsewhere by then
    edges, poses = CertifiedEdges(robot, given), scene.samples[:, POSE]
    if math.isinf(scene.reference.duration):
        goal = robot.solve(poses[0], start)
        if goal.success and not (edge := edges.clear(start, goal.q)).certified:
            yield (
                f"{case.names.label}: straight to the set-point joints meet {edge.label}; a law keeps away and may be "
                "held there: reference plan-to goes around"
            )
    elif robot.configuration_size >= FULL_POSE:
        chosen = np.unique(np.linspace(0, len(poses) - 1, PATH_SAMPLES).astype(int))
        first = robot.solve(poses[0], start, restarts=0)
        found = continued(edges, first.q, poses[chosen])
        if first.success and found.pair:
            time = scene.samples[chosen[len(found.configurations)], TIME]
            yield f"{case.names.label}: at t = {time:.3g} s the path meets {found.why}"


def run_remarks(setting: PreparedExperiment) -> Iterator[str]:
    """Give what is to be known of each run besides, in a line each: free wheels, detours, errors about an origin."""
    for scene in setting.scenes.values():
        yield from _of_free_wheels(scene.robot)
        yield from _of_detour(scene)
    for case in setting.cases:
        yield from _of_the_origin(case)


def _of_free_wheels(robot: Robot) -> Iterator[str]:
    """Say which velocities of a robot's bases nothing limits: whatever a law asks for is commanded."""
    moving = np.flatnonzero(base_coordinates(robot)[robot.input_coordinates])
    free = [robot.input_names[i] for i in moving if np.isinf(robot.limits.velocity[i])]
    if free:
        yield (
            f"{robot.name}: no velocity limit of {', '.join(free)} is known, so the base is commanded however fast a "
            "law asks: give its limits in the robot's file"
        )


def _of_detour(scene: PreparedRobot) -> Iterator[str]:
    """Say how far a base drives around what stands in its way, where that is much farther than straight."""
    if isinstance(scene.reference, DriveTo):
        driven, straight = scene.reference.detour
        if driven > _DETOUR * straight:
            yield f"reference: detour: {driven:.2g} m for {straight:.2g} m, around what stands there"


def _of_the_origin(case: Combination) -> Iterator[str]:
    """Say how far from the origin an end effector is to be where its law's error depends on where the origin is."""
    law = case.variant.law
    key = {laws.HInfinity: "form", laws.LinearQuadraticDQ: "error"}
    field = next((key[kind] for kind in key if isinstance(law, kind)), "")
    if not field or getattr(law, field) != "right":
        return
    far = float(np.linalg.norm(algebra.translation(case.scene.samples[:, POSE]), axis=1).max())
    if far > _FAR:
        yield (
            f"{case.names.label}: its error depends on where the origin is: {far:.3g} m from it an orientation error "
            f"of 1° counts as {1e3 * far * math.radians(1):.3g} mm of position; take {field}: left, which does not"
        )


def too_few_joints(robot: Robot) -> str:
    """Say that a robot has too few joints for a pose, and what helps."""
    joints = f"{robot.name} has {robot.input_size} joints and a pose takes 6"
    return f"{joints}; law partial-proportional asks for its position alone"


def way_out(law: laws.Law) -> str:
    """Say what leads a law out of a singularity in which it stands still."""
    if isinstance(law.null_space, laws.ManipulabilityAscent):
        return "start elsewhere"
    return "start elsewhere, or leave it with null_space: {kind: manipulability, gain: 1}"


def _of_singular_start(case: Combination) -> Iterator[str]:
    """Say if a law would stand still at its start, as no joint moves the end effector towards the first other pose."""
    scene, law = case.scene, case.variant.law
    if isinstance(law, laws.OpenLoop | laws.JointMotion) or isinstance(
        law.null_space, laws.ManipulabilityAscent
    ):
        return
    robot, desired = scene.robot, scene.samples[:, POSE]
    error = algebra.short(algebra.multiply(algebra.conjugate(robot.fkm(scene.start)), desired))
    far = np.abs(error - _NONE).max(axis=1) > _ERROR
    part = law.part if isinstance(law, laws.PartialProportional) else "pose"
    if not far.any():
        return
    if lost_share(robot, scene.start, desired[far.argmax()], part, inverse_of(law)) > _ALL:
        yield (
            f"{case.names.label}: starts in a singularity where no joint can move the end effector towards the "
            f"reference, so that every command is zero; {way_out(law)}"
        )


def _of_constraints(setting: PreparedExperiment, case: Combination) -> Iterator[str]:
    """Say which constraint has least room at the start, and how much more than asked is kept, for what."""
    kept = case.prepare_law(setting.spec).constraints
    if kept is None or not kept.labels:
        return
    room = kept.values(case.scene.start[None], [0.0])[0] - kept.asked
    least, between = int(np.argmin(room)), np.where(kept.is_angle, 0.0, kept.allowances).max()
    text = (
        f"{case.names.label}: constraints: {len(kept.labels)} distances and angles; least room at the start: "
        f"{kept.labels[least]}, {kept.text(least, room[least] + kept.asked[least])}; samples keep up to "
        f"{1e3 * between:.2g} mm more, for what happens between them"
    )
    if late := kept.lag.late:
        around = (_HAND_SPEED * max(kept.lag.times) / len(kept.way.shares)) ** 2 / (8 * _BALL)
        text += (
            f"; joints come up to {1e3 * late:.3g} ms late: their whole way to their targets is kept clear, and "
            f"between its points {1e3 * around:.2g} mm more at {_HAND_SPEED:g} m/s around a ball of "
            f"{1e3 * _BALL:.0f} mm, and {1e3 * late * 0.1:.2g} mm from what may come nearer unforeseen with 0.1 m/s"
        )
    yield text


def _of_path(scene: PreparedRobot) -> Iterator[str]:
    demand, robot = path_demand(scene), scene.robot
    if demand is None:
        return
    if not demand.left.succeeded and demand.left.error:
        why = "a singularity or the reach of the arm is in the way; start elsewhere, or move the reference"
        if robot.input_size < 6:
            why = too_few_joints(robot)
        elif len(robot.drives):
            why = "a base with wheels cannot go sideways; start with another heading, nearer, or go slower"
        share = SETTLED if demand.left.at_rest else FOLLOWED
        yield (
            f"reference: cannot be followed by {robot.name}: even with ideal joints the end effector "
            f"{demand.left.error}, more than {100 * share:.0f} % of the motion: {why}"
        )
    if demand.peak_share > _SHARES:
        slower = math.ceil(100 * demand.peak_share) / 100  # as much as it takes: 1.003 is not "1"
        yield (
            f"reference: needs {demand.joint} at {percent_text(demand.peak_share, 4)} of its velocity limit, at "
            f"t = {demand.time:.3g} s: make it {slower:g} times slower (duration), or start elsewhere"
        )


def _of_rolling(setting: PreparedExperiment, case: Combination) -> Iterator[str]:
    """Say how far a mobile base rolls when nothing is measured any more, where somebody says `stale_after`."""
    robot, given = case.scene.robot, setting.spec.supervisor_of(case.plant)
    if given is None or given.stale_after is None or not base_coordinates(robot).any():
        return
    bounds = given.prepare(robot, setting.spec.period, command_mode(case.plant)).bounds
    base = np.flatnonzero(bounds.is_joint == 0.0)
    ahead = base[:1] if len(robot.drives) else base[:2]  # v, or x and y
    fastest = float(np.linalg.norm(bounds.velocity[ahead]))
    way = fastest * given.stale_after + 0.5 * fastest**2 / float(bounds.acceleration[ahead].min())
    yield (
        f"{case.names.label}: the base rolls up to about {way:.2g} m before it stands when nothing is measured any "
        f"more: at {fastest:.3g} m/s for stale_after {given.stale_after:g} s, and while it brakes"
    )


def _of_first_command(setting: PreparedExperiment, case: Combination) -> Iterator[str]:
    """Say if the first command is beyond the velocity limits, where that is a velocity."""
    robot, law = case.scene.robot, case.variant.law
    if command_mode(case.plant) == "measured" or isinstance(law, laws.OpenLoop | laws.JointMotion):
        return
    if not np.isfinite(robot.limits.velocity).any():
        return
    free = case.prepare_law(setting.spec).with_limits(CommandLimits(velocity=False))
    state = free.initial_state(case.scene.start)
    row = case.scene.samples[0]
    try:
        command = free.command(case.scene.start, Sample(row[POSE], row[TWIST], row[TWIST_RATE]), state)
    except DivergedError:
        return
    shares = np.abs(command) / robot.limits.velocity
    if shares.max() > _SHARES:
        joint = robot.input_names[int(shares.argmax())]
        limited = case.limits.velocity or setting.spec.supervisor_of(case.plant) is not None
        then = "commands are scaled to it" if limited else "limits: {velocity: true} scales commands to it"
        asked = percent_text(shares.max(), 3)
        yield f"{case.names.label}: its first command is {asked} of {joint}'s velocity limit; {then}"
