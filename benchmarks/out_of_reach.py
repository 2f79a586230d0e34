"""How calm laws stay where a target is out of reach, and what that costs within reach; goals stand beside the values.

python benchmarks/out_of_reach.py             all tables, about 15 minutes
python benchmarks/out_of_reach.py --growth 0  as if damping did not grow
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import dqcontrol as dqc
from dqcontrol import algebra, controller, laws
from dqcontrol.arrays import Array
from dqcontrol.limits import CommandLimits
from dqcontrol.loop import close_loop
from dqcontrol.loop.targets import PoseTarget, Speeds
from dqcontrol.plants import Integrator, Servo

SEED = 38
TURNING = 0.01  # rad/s: slower joints are at rest
HONEST = (
    12.0  # rad/s², what joints of arms do: slower than that times T, one that turns back may do so honestly
)
STARTS = {
    "panda": [0, -0.3, 0, -2.0, 0, 1.7, 0.7],
    "ur5": [0, -1.2, 1.5, -1.8, -1.5, 0.3],
    "iiwa7": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "youbot-arm": [0.1, 0.4, -0.6, 0.3, 0.2],
    "little-john": [0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4],
}
ARMS = ("panda", "ur5", "iiwa7", "youbot-arm")
# The youBot's arm starts upright: σ is below ε there, and the filter damps whatever the error.
MIDDLES = STARTS | {"youbot-arm": [0.1, 0.9, -1.3, 0.9, 0.2]}
PERIODS = (0.001, 0.01, 0.033)  # s
JITTER = 0.003  # m, of a camera at 30 Hz, and three times as many rad: 0.5°
SCALED = CommandLimits(velocity=True)
SERVOS = ((0.0, 0.0), (0.03, 0.0), (0.1, 0.02), (0.3, 0.05), (0.0, 0.05))  # lag and delay, s


def all_laws(k: float, period: float) -> dict[str, laws.Law]:
    """Return laws of loop gain k, 1/s; feedback linearisation with k_v T ≤ 1.5, as 2 is its limit at any target."""
    damping = min(4 * k, 1.5 / period)
    return {
        "K": laws.Proportional(gain=k),
        "K+FF": laws.ProportionalFeedforward(gain=k),
        "decoupled": laws.DecoupledProportional(gain=k),
        "HIR, right": laws.HInfinity(orientation_gain=2 * k, translation_gain=k),
        "HIRT, left": laws.HInfinityTracking(orientation_gain=2 * k, translation_gain=k, form="left"),
        "LQR-R8": laws.LinearQuadraticR8(error_weight=k * k, control_weight=1.0),
        "LQR-DQ, right": laws.LinearQuadraticDQ(error_weight=k * k, control_weight=1.0),
        "LQR-DQ, left": laws.LinearQuadraticDQ(error_weight=k * k, control_weight=1.0, error="left"),
        "feedback linearisation": laws.FeedbackLinearization(
            stiffness=4 * k * damping, damping=damping, null_space=None
        ),
    }


def with_growth(law: laws.Law, growth: float | None) -> laws.Law:
    """Return a law with another growth of its inverse."""
    inverse = msgspec.structs.replace(law.inverse, growth=growth)  # type: ignore[attr-defined]
    return msgspec.structs.replace(law, inverse=inverse)


def placed(pose: Array, position: Array) -> Array:
    """Return a pose of the same orientation at another position."""
    moved = np.zeros(8)
    moved[0], moved[5:8] = 1.0, 0.5 * position
    return algebra.multiply(moved, np.concatenate([pose[:4], np.zeros(4)]))


def stretched(robot: dqc.Robot, q: Array, direction: Array | None = None) -> Array:
    """Return the joints with the hand furthest from the base, or along a direction; mobile bases rest."""
    still = robot.configuration_size - 5 if robot.drives.size else 0

    def short(x: Array) -> float:
        hand = algebra.translation(robot.fkm(np.concatenate([q[:still], x])))
        return -float(np.linalg.norm(hand) if direction is None else direction @ hand)

    bounds = list(zip(robot.limits.lower[still:], robot.limits.upper[still:], strict=True))
    return np.concatenate([q[:still], minimize(short, q[still:], bounds=bounds).x])


def furthest(robot: dqc.Robot, q: Array, direction: Array) -> Array:
    """Return the pose of the hand at its furthest along a direction."""
    return robot.fkm(stretched(robot, q, direction))


def resting_targets(robot: dqc.Robot, q: Array) -> dict[str, Array]:
    """Return targets that nothing of the robot reaches, by name."""
    pose = robot.fkm(q)
    direction = algebra.translation(pose) / np.linalg.norm(algebra.translation(pose))
    far = furthest(robot, q, direction)
    reach = float(np.linalg.norm(algebra.translation(far)))
    along = {"twice the reach": 2 * reach, "10 m": 10.0}
    beyond = {f"{way * 1e3:g} mm beyond": way for way in (0.001, 0.003, 0.01, 0.03, 0.1)}
    return {
        **{name: placed(pose, way * direction) for name, way in along.items()},
        **{name: placed(far, algebra.translation(far) + way * direction) for name, way in beyond.items()},
        "above": placed(pose, np.array([0.05, 0.1, 2 * reach])),
        "aside": placed(pose, np.array([0.2, -2 * reach, 0.3])),
    }


def follow(
    prepared: controller.Controller, q: Array, samples: Callable[[int], dqc.Sample], steps: int
) -> tuple[Array, Array]:
    """Let a law drive ideal joints in a loop of one's own, scaled to the velocity limits; return commands, joints."""
    robot, period = prepared.robot, prepared.period
    state, joints = prepared.initial_state(q), q.copy()
    sent, gone = np.empty((steps, robot.input_size)), np.empty((steps, q.size))
    for k in range(steps):
        u = prepared.command(joints, samples(k), state)
        u = u / max(1.0, np.max(np.abs(u) / robot.limits.velocity))
        prepared.sent(state, u)
        joints = robot.integrate(joints, u, period)
        sent[k], gone[k] = u, joints
    return sent, gone


def turning_back(sent: Array, least: float = TURNING) -> NDArray[np.bool_]:
    """Return in which periods some joint turns back, faster than ``least`` before and after, rad/s."""
    before, after = sent[:-1], sent[1:]
    turning = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > least)
    return np.any(turning, axis=1)


def reversing(sent: Array, least: float = TURNING) -> float:
    """Return the share of these periods."""
    return float(turning_back(sent, least).mean())


def worst_at_rest(
    name: str,
    law: str,
    period: float,
    growth: float | None,
    targets: tuple[str, ...] = (),
    most: float = 10.0,
) -> tuple[float, str]:
    """Return the worst share of reversing periods in the last quarter of a rest out of reach, and where.

    The gain is ``most``, 1/s, or 0.5/T if that is less.
    """
    robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
    k = min(most, 0.5 / period)
    prepared = with_growth(all_laws(k, period)[law], growth).prepare(robot, None, period, SCALED)
    worst, where, steps = 0.0, "", max(round(4.0 / period), 600)
    for target, pose in resting_targets(robot, q).items():
        if targets and target not in targets:
            continue
        samples = np.repeat(dqc.Sample(pose).numbers[None], steps, axis=0)
        trace = close_loop(prepared, Integrator().start(robot, q, period, steps, SEED), samples)
        share = reversing(trace.command[-steps // 4 :])
        if share > worst:
            worst, where = share, target
    return worst, where


def shaken(pose: Array, position: Array, noise: Array) -> Array:
    """Return a pose at a position, moved by noise (6,): three times as large in rad as in m."""
    turn = algebra.exp_screw(np.array([*(1.5 * noise[3:]), 0, 0, 0]))
    return placed(algebra.multiply(np.concatenate([pose[:4], np.zeros(4)]), turn), position + noise[:3])


def streams(robot: dqc.Robot, q: Array, period: float) -> dict[str, Array]:
    """Return hostile streams of targets: 10 s of what people, cameras and networks do, between 3 s and 5 s of calm."""
    rng, axes = np.random.default_rng(SEED), np.eye(3)
    home, times = robot.fkm(q), period * np.arange(round(10.0 / period))
    here, whole = algebra.translation(home), np.concatenate([home[:4], np.zeros(4)])
    reach = float(np.linalg.norm(algebra.translation(furthest(robot, q, here / np.linalg.norm(here)))))
    out = here / np.linalg.norm(here)
    ball, noise = rng.normal(size=(400, 3)), rng.normal(size=(400, 6))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    far = rng.uniform(0.2, 2.0, (400, 1))
    turns = [algebra.exp_screw(np.array([*(0.5 * np.pi * axis), 0, 0, 0])) for axis in axes]

    def at(position: Array, turn: Array | None = None) -> Array:
        return placed(home if turn is None else algebra.multiply(whole, turn), position)

    def turned(axis: Array, angle: float) -> Array:
        return algebra.exp_screw(np.array([*(0.5 * angle * axis), 0, 0, 0]))

    def circle(time: float, radius: float, rate: float) -> Array:
        return radius * np.array([np.cos(rate * time), np.sin(rate * time), 0.3])

    def frame(time: float, rate: float) -> int:
        return int(time * rate + 1e-9)

    def held(time: float, rate: float) -> float:
        return frame(time, rate) / rate

    def jittered(time: float, position: Array, size: float) -> Array:
        return shaken(home, position, noise[frame(time, 30.0) % 400] * size)

    def gapped(time: float) -> float:
        """Return when the last frame came where frames of 30 Hz come in bursts, with gaps of up to 1 s."""
        return held(time, 30.0) if (time % 2.5) < 1.5 else 2.5 * (time // 2.5) + 1.5

    wrist = axes[1]
    wanted: dict[str, Callable[[float], Array]] = {
        "teleports, 0.5 s": lambda t: at(ball[frame(t, 2)] * reach * far[frame(t, 2)]),
        "teleports, 1 s": lambda t: at(ball[frame(t, 1)] * reach * far[frame(t, 1)]),
        "teleports, 2 s": lambda t: at(ball[frame(t, 0.5)] * reach * far[frame(t, 0.5)]),
        "teleports outside, 1 s": lambda t: at(ball[50 + frame(t, 1)] * 1.5 * reach),
        "teleports and turns, 1 s": lambda t: at(ball[70 + frame(t, 1)] * reach, turns[frame(t, 1) % 3]),
        "there and 10 m away, 1 s": lambda t: at(here if frame(t, 1) % 2 else 10.0 * out),
        "steps, 1.3 reach, 0.5 rad/s": lambda t: at(circle(held(t, 30), 1.3 * reach, 0.5)),
        "steps, 1.3 reach, 1.5 rad/s": lambda t: at(circle(held(t, 30), 1.3 * reach, 1.5)),
        "steps, 2 reaches, 1 rad/s": lambda t: at(circle(held(t, 30), 2.0 * reach, 1.0)),
        "steps at the edge": lambda t: at(circle(held(t, 30), 0.98 * reach, 0.5)),
        "steps, in and out": lambda t: at((1 + 0.5 * np.sin(1.5 * held(t, 30))) * out * reach),
        "through the base, 4 s": lambda t: at((1 - 2 * ((t / 4) % 1)) * here),
        "through the base, 2 s": lambda t: at(np.cos(np.pi * t) * here),
        "beside the base": lambda t: at(np.cos(0.5 * np.pi * t) * here + 0.05 * axes[1]),
        "down the base's axis": lambda t: at(np.array([0.02, 0.0, reach * (1.3 * np.cos(0.5 * t) - 0.3)])),
        "wrist swings": lambda t: at(here, turned(wrist, 1.5 * np.sin(1.5 * t))),
        "wrist swings, stretched": lambda t: at(0.99 * reach * out, turned(wrist, 1.0 * np.sin(t))),
        "wrist swings, outside": lambda t: at(1.3 * reach * out, turned(wrist, 1.5 * np.sin(1.5 * t))),
        "half turns, 1 s": lambda t: at(here, turned(axes[frame(t, 1) % 3], np.pi * (frame(t, 1) % 2))),
        "half turns, 2 s": lambda t: at(here, turned(axes[frame(t, 0.5) % 3], np.pi * (frame(t, 0.5) % 2))),
        "half turns, outside": lambda t: at(1.3 * reach * out, turned(axes[0], np.pi * (frame(t, 1) % 2))),
        "round and round": lambda t: at(here, turned(axes[0], 1.5 * held(t, 30))),
        "gaps, circle outside": lambda t: at(circle(gapped(t), 1.2 * reach, 1.0)),
        "gaps, line in and out": lambda t: at((1 + 0.5 * np.sin(1.5 * gapped(t))) * out * reach),
        "gaps of 0.3 s": lambda t: at(circle(held(t, 3.0), 1.2 * reach, 0.5)),
        "jitter of 1 mm, outside": lambda t: jittered(t, 1.2 * reach * out, 0.001),
        "jitter of 3 mm, outside": lambda t: jittered(t, 1.5 * reach * out, JITTER),
        "jitter of 3 mm, at the edge": lambda t: jittered(t, 1.01 * reach * out, JITTER),
    }

    before, after = (np.repeat(dqc.Sample(home).numbers[None], round(s / period), axis=0) for s in (3.0, 5.0))
    return {
        name: np.concatenate([before, [dqc.Sample(pose(t)).numbers for t in times], after])
        for name, pose in wanted.items()
    }


def stream_table() -> None:
    """Print shares of reversing periods of streams, over robots, servos and ways to close the loop."""
    print(
        "\n28 hostile streams × 5 servos, decoupled law, k = min(10, 0.3/(lag + delay + T)): reversing periods, %, mean"
        "\n(goal 0.5) and worst (goal 5); worst while the target rests; without growth: mean, worst, worst while it"
        "\nrests; greatest step / (limit · T) (goal 1); where most"
    )
    everything: dict[str, float] = {}
    for period in (0.01, 0.033):
        for name in ARMS:
            robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
            given, limit = streams(robot, q, period), robot.limits.velocity * period
            hostile = slice(round(3.0 / period), round(13.0 / period))
            shares: dict[str, float] = {}
            resting, without, most = [0.0], [], 0.0
            for lag, delay in SERVOS:
                servo = Servo(time_constant=lag, delay=delay, position_limit=False)
                law = laws.DecoupledProportional(gain=min(10.0, 0.3 / (lag + delay + period)))
                for growth in (None, 0.0):
                    prepared = with_growth(law, growth).prepare(
                        robot, None, period, SCALED, lag=servo.lag(robot)
                    )
                    for stream, samples in given.items():
                        plant = servo.start(robot, q, period, len(samples), SEED)
                        trace = close_loop(prepared, plant, samples)
                        turns = turning_back(trace.command[hostile], HONEST * period)
                        share, rests = turns.mean(), ~np.diff(samples[hostile], axis=0).any(axis=1)
                        alone = float((turns & rests).mean())
                        if growth == 0.0:
                            without.append((share, alone))
                            continue
                        resting.append(alone)
                        shares[f"{stream}; {1e3 * lag:g} + {1e3 * delay:g} ms"] = share
                        most = max(most, float((np.abs(np.diff(trace.q, axis=0)) / limit).max()))
            worst = sorted(shares, key=lambda place: -shares[place])[:3]
            everything |= {f"{place}, {name}, {period}": share for place, share in shares.items()}
            found = 100 * np.array(list(shares.values()))
            print(
                f"  {name:10} {1e3 * period:3.0f} ms  {found.mean():5.2f} {found.max():6.2f}"
                f" {100 * max(resting):6.2f}   {100 * np.mean(without, axis=0)[0]:5.1f}"
                + "".join(f" {100 * share:6.1f}" for share in np.max(without, axis=0))
                + f"   {most:.3f}   "
                + ", ".join(f"{100 * shares[place]:.1f} {place}" for place in worst),
                flush=True,
            )
    found = 100 * np.array(list(everything.values()))
    print(f"  all {len(found)}: {found.mean():.2f} in the mean, {found.max():.2f} at worst")


def command_table() -> None:
    """Print what is left of the streams' reversing periods where they come through the product's own target."""
    speeds = Speeds(linear=0.5, angular=1.5, acceleration=3.0)
    print(
        f"\nthe same streams through PoseTarget, as jog and ROS 2 send them, with {speeds.linear} m/s, {speeds.angular}"
        f" rad/s, {speeds.acceleration} m/s²;\nideal joints: reversing periods, %, mean and worst"
    )
    for period in (0.01, 0.033):
        for name in ARMS:
            robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
            law = laws.DecoupledProportional(gain=min(10.0, 0.3 / period))
            prepared, shares = law.prepare(robot, None, period, SCALED), {}
            for stream, samples in streams(robot, q, period).items():
                sent = follow_asked(prepared, q, samples[: round(13.0 / period)], speeds)
                shares[stream] = 100 * reversing(sent[round(3.0 / period) :], HONEST * period)
            worst = max(shares, key=lambda stream: shares[stream])
            mean = np.mean(list(shares.values()))
            print(
                f"  {name:10} {1e3 * period:3.0f} ms  {mean:5.2f} {shares[worst]:6.2f}   {worst}", flush=True
            )


def follow_asked(prepared: controller.Controller, q: Array, samples: Array, speeds: Speeds) -> Array:
    """Let the hand follow a target that each new pose of samples is asked of; return the commands."""
    robot, period = prepared.robot, prepared.period
    state, target, sent = prepared.initial_state(q), PoseTarget(speeds), np.empty((len(samples), q.size))
    target.start(robot.fkm(q))
    for k, sample in enumerate(samples):
        if k == 0 or not np.array_equal(sample, samples[k - 1]):
            target.ask(k * period, sample[:8])
        row = target.sample(k * period, robot.fkm(q))
        u = prepared.command(q, dqc.Sample.of_row(row), state)
        sent[k] = u / max(1.0, np.max(np.abs(u) / robot.limits.velocity))
        prepared.sent(state, sent[k])
        q = robot.integrate(q, sent[k], period)
    return sent


def jitter_table(period: float = 0.01) -> None:
    """Print what joints do where the target jitters, within reach, at its edge and beyond."""
    print(
        "\njitter of 3 mm and 0.5° at 30 Hz, T = 10 ms, ideal joints, k = 10: reversing periods, %; those where no"
        "\nnew target had come, %; RMS speed of the fastest joint, rad/s; standard deviation of the joint that"
        "\nmoves most, °; each with growth | without"
    )
    noise = JITTER * np.random.default_rng(SEED).normal(size=(400, 6))
    times = period * np.arange(round(13.0 / period))
    frames = (30.0 * times + 1e-9).astype(int)
    fresh = np.diff(frames)[round(3.0 / period) :] > 0
    for name in ARMS:
        robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
        home = robot.fkm(q)
        here = algebra.translation(home)
        far = algebra.translation(furthest(robot, q, here / np.linalg.norm(here)))
        places = {"start": here, "0.95 reach": 0.95 * far, "1.01 reach": 1.01 * far, "1.1 reach": 1.1 * far}
        for place, position in places.items():
            poses = [shaken(home, position, each) for each in noise]
            samples = np.array([dqc.Sample(poses[frame % 400]).numbers for frame in frames])
            cells = []
            for growth in (None, 0.0):
                law = with_growth(laws.DecoupledProportional(gain=10.0), growth)
                plant = Integrator().start(robot, q, period, len(samples), SEED)
                trace = close_loop(law.prepare(robot, None, period, SCALED), plant, samples)
                sent, moved = trace.command[round(3.0 / period) :], trace.q[round(3.0 / period) :]
                turns = turning_back(sent, HONEST * period)
                speed, swing = np.sqrt((sent**2).mean(axis=0)).max(), np.rad2deg(moved.std(axis=0).max())
                cells.append(
                    f"{100 * turns.mean():6.1f} {100 * (turns & ~fresh).mean():5.1f} {speed:6.2f} {swing:5.2f}"
                )
            print(f"  {name:10} {place:10}" + "  |".join(cells), flush=True)


def drive_table() -> None:
    """Print what the unconstrained form of a drive does, whose Jacobian says that it can move sideways."""
    print(
        "\nlittle-john in its unconstrained form, worst of nine resting targets out of reach, 45 to 60 s: reversing"
        "\nperiods, %; fastest turn back and fastest input, rad/s or m/s"
    )
    robot = dqc.load_robot("little-john").in_form("unconstrained")
    q, targets = np.array(STARTS["little-john"]), resting_targets(robot, np.array(STARTS["little-john"]))
    for period in (0.01, 0.033):
        for k in (10.0, 0.5 / period):
            for name, law in all_laws(k, period).items():
                prepared, worst, steps = (
                    law.prepare(robot, None, period, SCALED),
                    np.zeros(3),
                    round(60 / period),
                )
                for pose in targets.values():
                    samples = np.repeat(dqc.Sample(pose).numbers[None], steps, axis=0)
                    trace = close_loop(prepared, Integrator().start(robot, q, period, steps, SEED), samples)
                    late = trace.command[-steps // 4 :]
                    back = np.where(
                        late[:-1] * late[1:] < 0, np.minimum(np.abs(late[:-1]), np.abs(late[1:])), 0.0
                    )
                    worst = np.maximum(worst, [100 * reversing(late), back.max(), np.abs(late).max()])
                print(
                    f"  {period * 1e3:3.0f} ms kT {k * period:4.2g} {name:23}"
                    f" {worst[0]:6.2f} {worst[1]:6.3f} {worst[2]:6.2f}",
                    flush=True,
                )


def rest_table(growth: float | None) -> None:
    """Print the worst of resting targets, law by law."""
    print("\nresting targets out of reach: reversing periods, %, worst of nine targets (goal 0)")
    print(f"  {'':34}" + "".join(f"{name:>14}" for name in STARTS))
    for period in PERIODS:
        for most in (10.0, 0.5 / period):
            for law in all_laws(1.0, period):
                found = [worst_at_rest(name, law, period, growth, most=most) for name in STARTS]
                print(
                    f"  {period * 1e3:3.0f} ms kT {most * period:4.2g} {law:23}"
                    + "".join(f"{100 * share:14.1f}" for share, _ in found),
                    *{where for _, where in found if where},
                    flush=True,
                )


def swung(
    robot: dqc.Robot, middle: Array, swing: Array, period: float, seconds: float
) -> tuple[Array, list[dqc.Sample]]:
    """Return the start and the samples of a path that joints describe, so that all of it is within reach."""
    times = period * np.arange(round(seconds / period))
    q = middle + np.sin(1.5 * times)[:, None] * swing
    rates = 1.5 * np.cos(1.5 * times)[:, None] * swing
    twists = [robot.twist_jacobian(each) @ rate for each, rate in zip(q, rates, strict=True)]
    return q[0], [dqc.Sample(robot.fkm(each), twist) for each, twist in zip(q, twists, strict=True)]


def errors(robot: dqc.Robot, gone: Array, samples: list[dqc.Sample]) -> float:
    """Return the RMS distance of the hand from its target a period later, m."""
    targets = np.array([sample.pose for sample in samples[1:]])
    away = algebra.translation(robot.fkm(gone[:-1])) - algebra.translation(targets)
    return float(np.sqrt((away**2).sum(axis=1).mean()))


def reach_table() -> None:
    """Print errors on stretched paths, over those without growth, and whether calm paths are equal to the bit."""
    print(
        "\nwithin reach, kT 0.33: RMS error over that without growth (goal 1.02) of K and K+FF, almost stretched"
    )
    print("and back; and in the middle, where commands are to be equal to the bit")
    for name in ARMS:
        robot, q = dqc.load_robot(name), np.array(MIDDLES[name], dtype=float)
        far = stretched(robot, q)
        cells = []
        for middle, swing in ((far + 0.15 * (q - far), 0.12 * (q - far)), (q, np.full(q.size, 0.1))):
            begin, samples = swung(robot, middle, swing, 0.033, 8.0)
            for law in ("K", "K+FF"):
                both = [
                    follow(
                        with_growth(all_laws(10.0, 0.033)[law], growth).prepare(robot, None, 0.033),
                        begin,
                        samples.__getitem__,
                        len(samples),
                    )[1]
                    for growth in (None, 0.0)
                ]
                ratio = errors(robot, both[0], samples) / errors(robot, both[1], samples)
                cells.append(f"{ratio:.4f}" if middle is not q else str(np.array_equal(both[0], both[1])))
        print(f"  {name:12}" + "".join(f"{cell:>10}" for cell in cells), flush=True)


def step_table(rounds: int = 15, steps: int = 3000) -> None:
    """Print the processor's time of a step over that without growth, least of several interleaved rounds."""
    print(
        "\na step of the compiled loop over that without growth (goal 1.1): 1 mm, 2 cm, 20 cm away; at rest outside"
    )
    for name in ("panda", "ur5", "youbot-arm"):
        robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
        law, outside = laws.ProportionalFeedforward(gain=10.0), resting_targets(robot, q)["twice the reach"]
        prepared = law.prepare(robot, None, 0.01)
        rested = follow(prepared, q, lambda _: dqc.Sample(outside), 600)[1][-1]  # noqa: B023
        pose = robot.fkm(q)
        here = algebra.translation(pose)
        cells = []
        for begin, target in (
            *((q, placed(pose, here - np.array([way, 0, 0]))) for way in (0.001, 0.02, 0.2)),
            (rested, outside),
        ):
            samples = np.repeat(dqc.Sample(target).numbers[None], steps, axis=0)
            best = [np.inf, np.inf]
            both = [with_growth(law, growth).prepare(robot, None, 1e-6) for growth in (None, 0.0)]
            for _ in range(rounds):
                for i, each in enumerate(both):
                    plant, started = Integrator().start(robot, begin, 1e-6, steps, 0), time.process_time()
                    close_loop(each, plant, samples)
                    best[i] = min(best[i], time.process_time() - started)
            cells.append(best[0] / best[1])
        print(f"  {name:12}" + "".join(f"{cell:8.2f}" for cell in cells), flush=True)


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--growth", type=float, help="c of the inverse; by the law's loop if omitted")
    parser.add_argument(
        "--tables", default="reach,steps,rest,streams,commands,jitter,drives", help="which of them"
    )
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    print(f"seed {SEED}")
    tables: dict[str, Callable[[], None]] = {
        "reach": reach_table,
        "steps": step_table,
        "rest": lambda: rest_table(asked.growth),
        "streams": stream_table,
        "commands": command_table,
        "jitter": jitter_table,
        "drives": drive_table,
    }
    for name in asked.tables.split(","):
        tables[name]()


if __name__ == "__main__":
    main()
