"""What a step costs as robots grow: chains of 3 to 60 joints, bodies with 1 to 4 arms."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import NullFormatter
from measure import Ratio, medians

import dqcontrol as dqc
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator
from dqcontrol.robots.kinematics import kinematics_kernels as kernels

COUNTS = (3, 4, 6, 7, 10, 14, 20, 30, 40, 60)
STEPS, PERIOD = 2000, 0.001
CACHED = 30_000  # numbers of a batch: a quarter of a megabyte; larger ones measure the memory


def chain(joints: int) -> dqc.SerialArm:
    """Return an arm of alternating axes whose reach does not grow."""
    turns = np.where(np.arange(joints) % 2, np.pi / 2, -np.pi / 2)
    zeros = np.zeros(joints)
    return dqc.SerialArm.from_dh(zeros, np.full(joints, 1.4 / joints), zeros, turns)


def body(arms: int) -> dqc.WholeBody:
    """Return a drive with that many arms of seven joints in a row."""
    drive = dqc.DifferentialDrive(wheel_radius=0.03, half_track=0.13)
    return dqc.WholeBody([drive, *[chain(7) for _ in range(arms)]])


def step_times(robots: dict[str, dqc.Robot], rounds: int) -> dict[str, float]:
    """Return the time of a step of law K in the compiled loop, ns."""
    functions = {}
    for name, robot in robots.items():
        q = np.linspace(0.3, 0.9, robot.configuration_size)
        target = dqc.references.SetPoint(robot.fkm(q + 0.01))
        samples = target.samples(PERIOD * np.arange(STEPS))
        damped = dqc.laws.DampedInverse(damping=0.01)  # near singularities the default inverse costs more
        law = dqc.laws.Proportional(gain=5.0, inverse=damped).prepare(robot, target, PERIOD)

        def run(law=law, robot=robot, q=q, samples=samples) -> None:
            close_loop(law, Integrator().start(robot, q, PERIOD, STEPS, 0), samples)

        functions[name] = run
    return {name: t / STEPS * 1e3 for name, t in medians(functions, 3, rounds).items()}


def kinematics_times(robots: dict[str, dqc.Robot], rounds: int) -> dict[str, float]:
    """Return the time of pose and both Jacobians in a batch that stays in the cache, ns each."""
    functions, counts = {}, {}
    for name, robot in robots.items():
        width = 8 + 14 * robot.input_size
        counts[name] = CACHED // width
        rows = np.random.default_rng(0).uniform(-1, 1, (counts[name], robot.configuration_size))
        out = np.empty((counts[name], width))
        functions[name] = partial(kernels.batch, kernels.kinematics.pointer, robot.chain, rows, out)
    return {name: t / counts[name] * 1e3 for name, t in medians(functions, 3, rounds).items()}


def slope(counts: list[int], times: list[float]) -> float:
    """Return the least squares exponent of times over counts, of the larger half."""
    half = len(counts) // 2
    return float(np.polyfit(np.log(counts[half:]), np.log(times[half:]), 1)[0])


def ratios(short: bool, picture: Path | None = None) -> list[Ratio]:
    """Return the growth with the number of joints: operations grow linearly, pose and Jacobians and law alike."""
    rounds = 3 if short else 9
    arms: dict[str, dqc.Robot] = {str(n): chain(n) for n in COUNTS}
    bodies: dict[str, dqc.Robot] = {f"{2 + 7 * k}": body(k) for k in range(1, 5)}
    found = {"pose and Jacobians": kinematics_times(arms, rounds), "step of law K": step_times(arms, rounds)}
    wide = {name: f(bodies, rounds) for name, f in zip(found, (kinematics_times, step_times), strict=True)}
    if picture is not None:
        figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
        for (name, times), marker in zip(found.items(), "os", strict=True):
            line = axes.loglog(
                [int(n) for n in times], list(times.values()), f"-{marker}", label=f"{name}, arms"
            )[0]
            others = wide[name]
            axes.loglog(
                [int(n) for n in others],
                list(others.values()),
                f"--{marker}",
                color=line.get_color(),
                mfc="none",
                label=f"{name}, drive with 1–4 arms",
            )
        axes.set(xlabel="inputs", ylabel="time [ns]")
        axes.set_xticks(COUNTS, [str(n) for n in COUNTS], minor=False)
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_yticks((200, 500, 1000, 2000), ("200", "500", "1000", "2000"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.legend()
        figure.savefig(picture)
        plt.close(figure)
    # Beside a constant part, every joint costs the same: the exponent of the larger half tends to 1 from below.
    exponents = {name: slope([int(n) for n in t], list(t.values())) for name, t in found.items()}
    return [
        Ratio(f"{name}: exponent of growth, 14–60 joints", exponent, "", "", 1.0, "≤ 1.15")
        for name, exponent in exponents.items()
    ]
