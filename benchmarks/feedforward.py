"""How near a hand stays to a moving target: K+FF of second order beside Mink, Pink, PlaCo and Drake.

All on the same terms: four arms follow five paths, 3 s each, with a command every 10 ms and the same velocity limits:
on ideal joints, on ideal joints whose limits are 0.7 of the speeds that the path asks for, and on servos with a lag of
50 ms and a delay of 20 ms. All load the same URDF, written from the arm's chain. All programs are stepped in turns,
sample after sample, in one process; a step is timed from the measured joints to the command.

Peers go to the next pose at once, as their differential inverse kinematics is meant: their task's error over a period
is the twist asked for. On servos that diverges for a delay, so there, as their examples do, they step a configuration
of their own and the servos follow it. K+FF (k = 10 1/s) is always fed back what is measured, and knows lag and delay.

At limits the peers' programs cut each joint alone, and let the others make up for it; K+FF scales the whole command, so
that the hand keeps its direction, and falls behind on its way. A row of its own is K+FF with each joint cut alone.

Printed are medians over arms and paths: position error (RMS and largest, from 0.5 s on), samples with a joint faster
than its limit, jerk of the joints (RMS) and the time of a step; then of each peer where it is ahead, and why. A peer
that is not installed, or fails, says so. Before it, what a Panda misses of a circle at 1 rad/s: K+FF as printed, with
a preview and of second order, and going to the next pose at once.

    python benchmarks/feedforward.py [--short]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import dqcontrol as dqc
from dqcontrol import algebra, references
from dqcontrol.laws import ProportionalFeedforward
from dqcontrol.laws.desired_twist import Feedforward
from dqcontrol.limits import CommandLimits
from dqcontrol.plants import Integrator, Servo
from dqcontrol.robots import Robot
from dqcontrol.tables import Column, Table

Array = np.ndarray
Step = Callable[[Array, int], Array]

ARMS = {
    "panda": [0, -0.6, 0, -2.2, 0, 1.6, 0.8],
    "iiwa7": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "ur5": [0, -1.2, 1.5, -1.2, -1.5, 0.3],
    "barrett-wam": [0, 0.6, 0, 1.6, 0, 0.6, 0],
}
PERIOD, DURATION, SKIPPED, GAIN = 0.01, 3.0, 0.5, 10.0
UNLIMITED = 10.0  # rad/s: for an arm whose speeds are not known, as not all programs take it without limits
LAG, DELAY, BOUND = 0.05, 0.02, 0.7
CIRCLE_LASTS = 5.0  # s
CASES = ("ideal joints", "at limits", "servos")
OURS, CUT = "K+FF", "K+FF, joints cut alone"
RMS, JERK = "RMS [µm]", "jerk [rad/s³]"
WHY = {
    (
        "at limits",
        RMS,
    ): "joints that are fast enough go on: K+FF with joints cut alone has most of that, and more jerk",
    ("servos", JERK): "their joints lag behind by millimetres, which smooths; the path itself asks for more",
}


def paths(arm: Robot, q: Array) -> dict[str, references.Reference]:
    """Return what the hand is to follow."""
    start = arm.fkm(q)
    times = np.linspace(0.0, DURATION, 7)
    sweep = q + 0.25 * np.sin(np.linspace(0.0, 2.0, 7))[:, None] * np.where(np.arange(len(q)) % 2, -1.0, 1.0)
    turn = np.array([start] * 7)
    for k, angle in enumerate(0.25 * (1 - np.cos(np.linspace(0.0, np.pi, 7)))):
        rotation = algebra.multiply(algebra.exp_body(np.array([0, angle, 0, 0, 0, 0])), np.eye(8)[0])
        turned = algebra.multiply(rotation, np.concatenate([algebra.rotation(start), np.zeros(4)]))[:4]
        turn[k] = algebra.pose(turned, algebra.translation(start))
    line = np.array([start] * 7)
    for k, share in enumerate(0.5 - 0.5 * np.cos(np.linspace(0.0, 2 * np.pi, 7))):
        line[k] = algebra.pose(algebra.rotation(start), algebra.translation(start) - [0.08 * share, 0, 0])
    return {
        "circle": references.Circle(start, radius=0.08, duration=DURATION),
        "circle across": references.Circle(start, radius=0.06, duration=DURATION, plane="yz"),
        "line": references.ViaPoints(times, line),
        "turn": references.ViaPoints(times, turn),
        "joints": references.ViaPoints(times, arm.fkm(sweep)),
    }


def as_urdf(arm: Robot, speeds: Array) -> str:
    """Return the chain as a URDF without shapes; its hand is the link ``hand``."""
    text, last = "<robot name='arm'><link name='l0'/>", len(arm.chain) - 1
    inertial = (
        "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>"
    )
    for i, row in enumerate(arm.chain):
        w, x, y, z = row[:4]
        roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        place = "<origin xyz='{} {} {}' rpy='{} {} {}'/>".format(*row[4:7], roll, pitch, yaw)
        ends = f"<parent link='l{i}'/><child link='{'hand' if i == last else f'l{i + 1}'}'/>"
        text += f"<link name='{'hand' if i == last else f'l{i + 1}'}'>{inertial}</link>"
        if i == last:
            text += f"<joint name='tip' type='fixed'>{place}{ends}</joint>"
        else:
            lower, upper = arm.limits.lower[i], arm.limits.upper[i]
            limit = f"<limit lower='{lower}' upper='{upper}' velocity='{speeds[i]}' effort='1000'/>"
            text += f"<joint name='j{i}' type='revolute'>{place}{ends}<axis xyz='0 0 1'/>{limit}</joint>"
    return text + "</robot>"


def matrix(pose: Array) -> Array:
    """Return a pose as a matrix, 4 × 4."""
    return np.asarray(dqc.DualQuaternion(pose).matrix())


@dataclass
class Task:
    """What each program is given: the arm, its start and limits, the samples, and whether joints lag."""

    arm: Robot
    q: Array
    speeds: Array
    reference: references.Reference
    lagging: bool
    times: Array = field(default_factory=lambda: PERIOD * np.arange(round(DURATION / PERIOD)))

    @property
    def next_poses(self) -> Array:
        """Matrices at the end of each period."""
        return np.array([matrix(each) for each in self.reference.samples(self.times + PERIOD)[:, :8]])


def by_us(task: Task) -> Step:
    """Return K+FF of second order, velocities scaled to the limits."""
    reference, plant = task.reference, Servo(time_constant=LAG, delay=DELAY)
    if task.lagging:
        reference = references.Previewed(reference, delay=DELAY + PERIOD / 2, lag=LAG, step=PERIOD)
    arm = with_speeds(task.arm, task.speeds)
    law = ProportionalFeedforward(gain=GAIN).prepare(
        arm,
        reference,
        PERIOD,
        CommandLimits(velocity=True),
        "integrated" if task.lagging else "measured",
        lag=plant.lag(arm) if task.lagging else Integrator().lag(arm),
    )
    samples, state, out = reference.samples(task.times), law.initial_state(task.q), np.empty(arm.input_size)
    given = [dqc.Sample.of_row(row) for row in samples]
    return lambda q, k: law.command(q, given[k], state, out)


def by_us_cut(task: Task) -> Step:
    """Return K+FF on ideal joints, each cut at its own limit."""
    law = ProportionalFeedforward(gain=GAIN).prepare(task.arm, task.reference, PERIOD)
    samples, state = task.reference.samples(task.times), law.initial_state(task.q)

    def step(q: Array, k: int) -> Array:
        u = np.clip(law.command(q, dqc.Sample.of_row(samples[k]), state), -task.speeds, task.speeds)
        law.sent(state, u)
        return u

    return step


def with_speeds(arm: Robot, speeds: Array) -> Robot:
    """Return the arm with other velocity limits."""
    from copy import copy
    from dataclasses import replace

    other = copy(arm)
    other.limits = replace(arm.limits, velocity=speeds)
    return other


def by_mink(task: Task) -> Step:
    """Return Mink's step to the next pose, by DAQP."""
    import mink
    import mujoco

    whole = "<robot name='arm'><mujoco><compiler fusestatic='false'/></mujoco>"
    model = mujoco.MjModel.from_xml_string(
        as_urdf(task.arm, task.speeds).replace("<robot name='arm'>", whole)
    )
    configuration, poses = mink.Configuration(model, task.q), task.next_poses
    frame = mink.FrameTask("hand", "body", position_cost=1.0, orientation_cost=0.3, gain=1.0)
    bounds = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, {f"j{i}": float(speed) for i, speed in enumerate(task.speeds)}),
    ]
    goals = [mink.SE3.from_matrix(pose) for pose in poses]

    def step(q: Array, k: int) -> Array:
        configuration.update(q)
        frame.set_target(goals[k])
        return mink.solve_ik(configuration, [frame], PERIOD, solver="daqp", limits=bounds)

    return step


def by_pink(task: Task) -> Step:
    """Return Pink's step to the next pose, by DAQP."""
    import pink
    import pinocchio

    model = pinocchio.buildModelFromXML(as_urdf(task.arm, task.speeds))
    configuration = pink.Configuration(model, model.createData(), task.q)
    frame = pink.tasks.FrameTask("hand", position_cost=1.0, orientation_cost=0.3, gain=1.0)
    goals = [pinocchio.SE3(pose) for pose in task.next_poses]

    def step(q: Array, k: int) -> Array:
        configuration.update(q)
        frame.set_target(goals[k])
        return pink.solve_ik(configuration, [frame], PERIOD, solver="daqp")

    return step


def by_placo(task: Task) -> Step:
    """Return PlaCo's step to the next pose: its own joint angles are set to what is measured before."""
    import placo

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.urdf"
        file.write_text(as_urdf(task.arm, task.speeds), encoding="utf-8")
        robot = placo.RobotWrapper(str(file), placo.Flags.ignore_collisions)
    solver = robot.make_solver()
    solver.mask_fbase(True)
    solver.enable_velocity_limits(True)
    solver.enable_joint_limits(True)
    solver.dt = PERIOD
    frame = solver.add_frame_task("hand", np.eye(4))
    frame.configure("hand", "soft", 1.0, 0.3)
    solver.add_regularization_task(1e-9)  # seven joints for six
    poses = task.next_poses

    def step(q: Array, k: int) -> Array:
        robot.state.q[7:] = q
        robot.update_kinematics()
        frame.T_world_frame = poses[k]
        solver.solve(True)
        return (np.array(robot.state.q[7:]) - q) / PERIOD

    return step


def by_drake(task: Task) -> Step:
    """Return Drake's differential inverse kinematics with the twist to the next pose."""
    from pydrake.multibody.inverse_kinematics import (
        DifferentialInverseKinematicsParameters,
        DoDifferentialInverseKinematics,
    )
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import JacobianWrtVariable

    plant = MultibodyPlant(PERIOD)
    Parser(plant).AddModelsFromString(as_urdf(task.arm, task.speeds), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("l0"))
    plant.Finalize()
    context, hand, world = plant.CreateDefaultContext(), plant.GetFrameByName("hand"), plant.world_frame()
    n = len(task.q)
    given = DifferentialInverseKinematicsParameters(n, n)
    given.set_time_step(PERIOD)
    given.set_joint_velocity_limits((-task.speeds, task.speeds))
    given.set_joint_position_limits((task.arm.limits.lower, task.arm.limits.upper))
    poses, last = task.next_poses, [np.zeros(n)]

    def step(q: Array, k: int) -> Array:
        plant.SetPositions(context, q)
        here = hand.CalcPoseInWorld(context).GetAsMatrix4()
        turn = poses[k][:3, :3] @ here[:3, :3].T
        axis = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        sine = np.linalg.norm(axis)
        axis *= np.arctan2(sine, 0.5 * (np.trace(turn) - 1)) / sine if sine > 1e-12 else 1.0
        twist = np.concatenate([axis, poses[k][:3, 3] - here[:3, 3]]) / PERIOD
        jacobian = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, hand, np.zeros(3), world, world
        )
        found = DoDifferentialInverseKinematics(q, last[0], twist, jacobian, given).joint_velocities
        last[0] = np.zeros(n) if found is None else np.asarray(found)
        return last[0]

    return step


PROGRAMS = {
    OURS: by_us,
    CUT: by_us_cut,
    "Mink": by_mink,
    "Pink": by_pink,
    "PlaCo": by_placo,
    "Drake": by_drake,
}


class Follower:
    """A program that drives a plant of its own."""

    def __init__(self, name: str, task: Task) -> None:
        self.step = PROGRAMS[name](task)
        plant = Servo(time_constant=LAG, delay=DELAY) if task.lagging else Integrator()
        self.plant = plant.start(task.arm, task.q, PERIOD, len(task.times) + 1, 0)
        self.own = task.q.copy() if task.lagging and name != OURS else None
        self.q, self.u, self.seconds = [self.plant.q.copy()], [], []

    def advance(self, k: int) -> None:
        """Step program and plant once."""
        q = self.plant.measured.copy() if self.own is None else self.own
        begin = time.perf_counter()
        u = self.step(q, k)
        self.seconds.append(time.perf_counter() - begin)
        u = np.array(u)
        if self.own is not None:
            self.own = self.own + PERIOD * u
        self.plant.step(u)
        self.u.append(u)
        self.q.append(self.plant.q.copy())

    def numbers(self, task: Task) -> Array:
        """Return RMS and largest error, µm, samples too fast, RMS jerk, rad/s³, and median time, µs."""
        q = np.array(self.q[: len(task.times)])
        wanted = algebra.translation(task.reference.samples(task.times)[:, :8])
        apart = np.linalg.norm(algebra.translation(task.arm.fkm(q)) - wanted, axis=1)[task.times > SKIPPED]
        jerk = np.diff(q[task.times > SKIPPED], 3, axis=0) / PERIOD**3
        fast = (np.abs(self.u) > task.speeds * (1 + 1e-6)).any(axis=1).sum()
        rms = [1e6 * np.sqrt(np.mean(apart**2)), 1e6 * apart.max()]
        return np.array([*rms, fast, np.sqrt(np.mean(jerk**2)), 1e6 * np.median(self.seconds)])


def asked_speeds(arm: Robot, q: Array, reference: references.Reference) -> Array:
    """Return the largest speed of each joint along a path."""
    record = dqc.simulate(arm, reference, ProportionalFeedforward(gain=GAIN), Integrator(), q, PERIOD)
    return np.abs(record.command[5:]).max(axis=0)


def measure(arms: list[str]) -> dict[tuple[str, str], list[Array]]:
    """Run all programs, and say which cannot."""
    found: dict[tuple[str, str], list[Array]] = {}
    failures: dict[tuple[str, str], list[str]] = {}
    for name in arms:
        arm, q = dqc.load_robot(name), np.array(ARMS[name], dtype=float)
        for reference in paths(arm, q).values():
            for case in CASES:
                speeds = np.minimum(arm.limits.velocity, UNLIMITED)
                if case == "at limits":
                    speeds = np.minimum(speeds, BOUND * asked_speeds(arm, q, reference) + 1e-3)
                task = Task(arm, q, speeds, reference, case == "servos")
                followers = {}
                for program in PROGRAMS:
                    if program == CUT and case != "at limits":
                        continue
                    try:
                        followers[program] = Follower(program, task)
                    except Exception as error:
                        failures.setdefault((case, program), []).append(f"{type(error).__name__}: {error}")
                for k in range(len(task.times)):
                    for program, follower in list(followers.items()):
                        try:
                            follower.advance(k)
                        except Exception as error:
                            failures.setdefault((case, program), []).append(
                                f"{type(error).__name__}: {error}"
                            )
                            del followers[program]
                for program, follower in followers.items():
                    found.setdefault((case, program), []).append(follower.numbers(task))
    for (case, program), why in failures.items():
        print(
            f"{case}: {program} fails on {len(why)} of {len(arms) * 5} paths, which its row leaves out: {why[0]:.150}"
        )
    return found


def next_pose_error(arm: Robot, q: Array, reference: references.Reference, period: float) -> float:
    """Return the RMS distance from a path, µm, of ideal joints that go to the next pose at once: u = J⁺ log(…)/T."""
    apart = []
    for pose in reference.samples(period * np.arange(1, round(CIRCLE_LASTS / period)))[:, :8]:
        way = 2 * algebra.log_inertial(algebra.multiply(pose, algebra.conjugate(arm.fkm(q))))
        q = q + np.linalg.pinv(arm.twist_jacobian(q)) @ way
        apart.append(algebra.translation(arm.fkm(q)) - algebra.translation(pose))
    late = np.array(apart)[round(CIRCLE_LASTS / 5 / period) :]
    return 1e6 * float(np.sqrt(np.mean(np.sum(late**2, axis=1))))


def circle_table() -> str:
    """Return the errors on a circle of 10 cm, of ideal joints and of servos, µm RMS from 1 s to 5 s."""
    arm, q = dqc.load_robot("panda"), np.array(ARMS["panda"])
    circle = references.Circle(arm.fkm(q), radius=0.1, duration=2 * np.pi)

    def error(period: float, servo: Servo | None, kind: Feedforward, led: float | None = None) -> float:
        path = circle if led is None else references.Previewed(circle, delay=DELAY + led, lag=LAG)
        law = ProportionalFeedforward(gain=GAIN, feedforward=kind)
        record = dqc.simulate(arm, path, law, servo or Integrator(), q, period, CIRCLE_LASTS)
        return 1e6 * float(np.sqrt(np.mean(record.position_error[record.time > CIRCLE_LASTS / 5] ** 2)))

    servo, rows = Servo(time_constant=LAG, delay=DELAY), []
    for period in (0.005, 0.01, 0.033):
        printed, second = (error(period, None, kind) for kind in ("printed", "second-order"))
        reached = next_pose_error(arm, q, circle, period)
        rows.append(["ideal", 1e3 * period, printed, np.nan, second, reached])
    for period in (0.005, 0.01, 0.033):
        printed, former = (error(period, servo, "printed", led) for led in (None, 0.0))
        rows.append(
            [
                "servos",
                1e3 * period,
                printed,
                former,
                error(period, servo, "second-order", period / 2),
                np.nan,
            ]
        )
    names = ("T [ms]", "printed", "printed, preview of lag and delay", "second order", "next pose")
    return Table([Column("joints"), *(Column(name, "", ".3g") for name in names)], rows).markdown()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--short", action="store_true", help="one arm only")
    short = parser.parse_args().short
    print(circle_table(), flush=True)
    found = measure(list(ARMS)[: 1 if short else None])
    names = (RMS, "largest [µm]", "too fast", JERK, "step [µs]")
    columns = [Column("joints"), Column("program"), *(Column(name, "", ".3g") for name in names)]
    rows, verdicts = [], []
    for (case, program), each in sorted(found.items(), key=lambda item: CASES.index(item[0][0])):
        numbers = np.median(each, axis=0)
        rows.append([case, program, *numbers])
        ours = np.median(found[case, OURS], axis=0)
        for i in (0, 3, 4):
            if program not in (OURS, CUT) and numbers[i] < ours[i]:
                why = WHY.get((case, names[i]))
                verdicts.append(f"{case}: {program} is ahead in {names[i]}" + (f": {why}" if why else ""))
    print(Table(columns, rows).markdown())
    print("\n".join(verdicts) or f"{OURS} is ahead of each in error, jerk and time")


if __name__ == "__main__":
    main()
