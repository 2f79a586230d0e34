"""Mobile manipulators in physics: speed against real time, drift of odometry, cubes that end in baskets.

Speeds are in processor time, of one core, and include the whole loop: law, MuJoCo and the record.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from msgspec import structs

import dqcontrol as dqc
from dqcontrol.plants import MobilePlant, WheeledBase
from dqcontrol_theses.silva2017.pick_and_drop_task import BASKET, CUBE, pick_and_drop

SEED = 20261209
PERIOD = 0.02
START = np.array([0, 0, 0, 0, -0.504, 1.397, 0, 0])
SCENES = 20
BODY: dict[str, Any] = {
    "mass": 26.0,
    "height": 0.09,
    "wheel_mass": 0.4,
    "wheel_torque": 5.0,
}  # kg, m, kg, N·m: as of a youBot


def speeds() -> tuple[float, float]:
    """Return simulated seconds a second of a drive, and of an errand with gripper, cube, basket and camera."""
    robot = dqc.load_robot("little-john")
    target = dqc.references.SetPoint(robot.fkm(robot.integrate(START, [0.2, 0.1, 0, 0, 0, 0, 0], 5.0)))
    law, plant = dqc.laws.FeedbackLinearization(stiffness=4.0, damping=4.0), MobilePlant()
    dqc.simulate(robot, target, law, plant, START, PERIOD, duration=1.0)
    start = time.process_time()
    dqc.simulate(robot, target, law, plant, START, PERIOD, duration=10.0)
    drive = 10.0 / (time.process_time() - start)
    pick_and_drop()  # compiles
    start = time.process_time()
    done = pick_and_drop()
    return drive, done.record.time[-1] / (time.process_time() - start)


def square(base: WheeledBase) -> tuple[float, float, float]:
    """Return error of odometry (m, rad) and largest slip (m/s) after a square of 1 m sides, driven as commanded."""
    robot = dqc.load_robot("little-john")
    live = MobilePlant(base=base).start(robot, START, PERIOD, 0, 0)
    slip = 0.0
    for _ in range(4):
        for v, omega, seconds in ((0.25, 0.0, 4.0), (0.0, np.pi / 4, 2.0)):
            for _ in range(round(seconds / PERIOD)):
                live.step(np.array([v, omega, 0, 0, 0, 0, 0]))
                slip = max(slip, float(np.abs(live.readings[4:7]).max()))
    error = live.odometry - live.q[:3]
    return float(np.hypot(*error[:2])), abs(float(error[2])), slip


def errands() -> int:
    """Return how many cubes of random scenes end in their baskets."""
    rng = np.random.default_rng(SEED)
    done = 0
    for seed in range(SCENES):
        angle, far, way = rng.uniform(-0.6, 0.6), rng.uniform(0.7, 1.2), rng.uniform(0.6, 1.2)
        cube = far * np.array([np.cos(angle), np.sin(angle)])
        turn = angle + rng.choice([-1, 1]) * rng.uniform(0.3, 2.2)
        basket = cube + way * np.array([np.cos(turn), np.sin(turn)])
        scene = (
            structs.replace(CUBE, position=(*cube, 0.015), rpy=(0.0, 0.0, rng.uniform(-3, 3))),
            structs.replace(BASKET, position=(*basket, 0.0)),
        )
        done += pick_and_drop(*scene, seed=seed).is_in_basket
    return done


def drive_square(
    base: dqc.MecanumBase | dqc.OmniBase, friction: float, side: float = 2.0, speed: float = 0.4
) -> tuple[np.ndarray, np.ndarray, float]:
    """Drive a square without turning, ahead, left, back and right, each side with minimum jerk at a mean speed, m/s.

    Returns
    -------
    tuple
        Length of each side in physics, (4,), m; where it ends, x, y and φ, (3,), of the zero of kinematics; and the
        greatest slip of a wheel, m/s.
    """
    robot, seconds = dqc.WholeBody([base]), side / speed
    live = MobilePlant(base=WheeledBase(friction=friction, **BODY)).start(robot, np.zeros(3), PERIOD, 0, 0)
    wheels = len(base.wheels)
    lengths, greatest, count = np.zeros(4), 0.0, round(seconds / PERIOD)
    for k, way in enumerate([(1.0, 0), (0, 1), (-1, 0), (0, -1)]):
        begin = live.q[:2].copy()
        for i in range(count + 25):  # half a second at rest
            t = min((i + 0.5) / count, 1.0)
            v = 30 * side / seconds * (t * (1 - t)) ** 2
            facing = live.q[
                2
            ]  # the velocity is that in the base's own axes, without a correction by the pose
            c, s = np.cos(facing), np.sin(facing)
            live.step(np.array([v * (c * way[0] - s * way[1]), v * (s * way[0] + c * way[1]), 0.0]))
            greatest = max(greatest, float(np.abs(live.readings[2 * wheels : 3 * wheels]).max()))
        lengths[k] = np.linalg.norm(live.q[:2] - begin)
    return lengths, live.q.copy(), greatest


def rollers() -> None:
    """Print how far mecanum and omni wheels come on a square of 2 m sides, against their kinematics."""
    for base in (
        dqc.MecanumBase(wheel_radius=0.05, half_track=0.158, half_wheelbase=0.228),
        dqc.OmniBase(wheel_radius=0.05, wheel_distance=0.2),
    ):
        for friction in (0.8, 0.4, 0.05):
            lengths, end, slip = drive_square(base, friction)
            short = 100 * np.abs(lengths / 2.0 - 1.0).max()
            back = 1e3 * np.hypot(*end[:2])
            print(
                f"{base.kind} wheels, square of 2 m, friction {friction:g}: sides {short:.2f} % off at most, back "
                f"within {back:.0f} mm, turned by {np.degrees(end[2]):.1f}°, slip up to {1e3 * slip:.0f} mm/s"
            )


def main() -> None:
    """Print all figures."""
    drive, errand = speeds()
    print(f"little-john drives:                        {drive:6.0f} × real time")
    print(f"little-john picks and drops, with camera:  {errand:6.0f} × real time")
    for friction in (0.8, 0.2, 0.1):
        far, turned, slip = square(WheeledBase(friction=friction))
        print(
            f"odometry after a square of 4 m, friction {friction:g}: off by {1e3 * far:.0f} mm and "
            f"{np.degrees(turned):.1f}°, slip up to {slip:.2f} m/s"
        )
    rollers()
    print(f"cubes in baskets, random scenes (seed {SEED}): {errands()} of {SCENES}")


if __name__ == "__main__":
    main()
