"""Inverse kinematics on random reachable poses: success and time a pose, ours against Pink and Robotics Toolbox.

    python benchmarks/inverse_kinematics.py [--poses 1000] [--seed 7] [--pink PYTHON] [--rtb PYTHON] [ROBOT …]

Success: within 1e-4 m, 1e-3 rad and all joint limits. Everybody starts from the middle of the joint limits and gets
the same chain. A peer runs in the interpreter given for it (this one by default), so that its requirements need not
fit ours: `pip install pin-pink daqp qpsolvers` or `pip install roboticstoolbox-python` there.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROBOTS = ["iiwa7", "panda", "ur5", "meka-a2", "kuka-lwr4", "barrett-wam"]
RESTARTS = 20  # of Pink, which has none of its own
STEPS = 50  # of Pink, a start; more did not help it
TARGET = (1e-4, 1e-3)  # m, rad


def timed(solve: Callable[[int], np.ndarray], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the configurations found for each pose, and the seconds that each took."""
    solve(0)  # compilation and caches
    q, seconds = [], np.empty(count)
    for i in range(count):
        start = time.perf_counter()
        q.append(solve(i))
        seconds[i] = time.perf_counter() - start
    return np.array(q), seconds


def pink(data: dict[str, np.ndarray], restarts: int) -> tuple[np.ndarray, np.ndarray]:
    """Iterate Pink's solve_ik to convergence; again from random configurations if it stalls."""
    import pinocchio as pin
    from pink import Configuration, solve_ik
    from pink.limits import ConfigurationLimit
    from pink.tasks import FrameTask

    def se3(row: np.ndarray) -> object:
        return pin.SE3(pin.Quaternion(*row[:4]).normalized().toRotationMatrix(), row[4:7])

    lower, upper, chain = data["lower"], data["upper"], data["chain"]
    model, parent, free = pin.Model(), 0, np.full(1, np.inf)
    for i, (low, high) in enumerate(zip(lower, upper, strict=True)):
        joint = pin.JointModelPZ() if chain[i, 7] else pin.JointModelRZ()
        bounds = (free, free, np.array([low]), np.array([high]))
        parent = model.addJoint(parent, joint, se3(chain[i]), f"joint_{i}", *bounds)
    model.addFrame(pin.Frame("tool", parent, 0, se3(chain[-1]), pin.FrameType.OP_FRAME))
    targets = [pin.SE3(matrix) for matrix in data["matrices"]]
    task = FrameTask("tool", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-3)
    configuration = Configuration(model, model.createData(), data["middle"])
    limits = [ConfigurationLimit(model, config_limit_gain=1.0)]
    rng = np.random.default_rng(0)

    def solve(i: int) -> np.ndarray:
        task.set_target(targets[i])
        for start in range(1 + restarts):
            configuration.update(data["middle"] if start == 0 else rng.uniform(lower, upper))
            for _ in range(STEPS):
                error = task.compute_error(configuration)
                if (
                    np.linalg.norm(error[:3]) < 0.5 * TARGET[0]
                    and np.linalg.norm(error[3:]) < 0.5 * TARGET[1]
                ):
                    return configuration.q.copy()
                velocity = solve_ik(
                    configuration, [task], 1.0, solver="daqp", limits=limits, safety_break=False
                )
                configuration.update(np.clip(configuration.q + velocity, lower, upper))
        return configuration.q.copy()

    return timed(solve, len(targets))


def toolbox(data: dict[str, np.ndarray], _: int) -> tuple[np.ndarray, np.ndarray]:
    """Call ik_LM of Robotics Toolbox, its compiled solver with restarts of its own."""
    import roboticstoolbox as rtb

    lower, upper, chain = data["lower"], data["upper"], data["chain"]
    parts = []
    for row, fixed in zip(chain, data["fixed"], strict=True):
        parts.append(rtb.ET.SE3(fixed))
        if len(parts) < 2 * len(lower):
            parts.append(rtb.ET.tz() if row[7] else rtb.ET.Rz())
    arm = rtb.ETS(parts)
    arm.qlim = np.array([lower, upper])
    tolerance = 0.5 * (0.5 * TARGET[0]) ** 2  # its residual is half the square of the error

    def solve(i: int) -> np.ndarray:
        return np.asarray(arm.ik_LM(data["matrices"][i], q0=data["middle"], tol=tolerance, k=0.1).q)

    return timed(solve, len(data["matrices"]))


WORKERS = {"pink": pink, "rtb": toolbox}


def peer(name: str, python: str, data: dict[str, np.ndarray], restarts: int = 0) -> tuple | str:
    """Return configurations and seconds of a peer, or why it could not be run."""
    with tempfile.TemporaryDirectory() as folder:
        given, answer = Path(folder) / "given.npz", Path(folder) / "answer.npz"
        np.savez(given, **data)  # type: ignore[arg-type]
        command = [python, __file__, "--worker", name, str(given), str(answer), str(restarts)]
        try:
            done = subprocess.run(command, capture_output=True, text=True)
        except OSError as error:
            return str(error)
        if done.returncode:
            return (done.stderr.strip().splitlines() or ["ended without a word"])[-1]
        with np.load(answer) as found:
            return found["q"], found["seconds"]


def work(name: str, given: str, answer: str, restarts: str) -> None:
    with np.load(given) as data:
        q, seconds = WORKERS[name](dict(data), int(restarts))
    np.savez(answer, q=q, seconds=seconds)


def main(names: list[str], count: int, seed: int, pink_python: str, rtb_python: str) -> None:
    import dqcontrol as dqc
    from dqcontrol import algebra

    print(
        f"{count} reachable poses a robot, seed {seed}; success within {TARGET[0]} m, {TARGET[1]} rad and the limits"
    )
    print(f"{'robot':12} {'solver':28} {'success':>8} {'median':>10} {'mean':>10} {'slowest':>10}")
    for name in names:
        arm = dqc.load_robot(name)
        lower, upper = arm.limits.lower, arm.limits.upper
        poses = arm.fkm(np.random.default_rng(seed).uniform(lower, upper, (count, arm.configuration_size)))
        desired = dqc.DualQuaternion(poses)

        def check(q: np.ndarray, arm: dqc.Robot = arm, desired: dqc.DualQuaternion = desired) -> float:
            """Return the share of successes, by our forward kinematics."""
            reached = dqc.DualQuaternion(arm.fkm(q))
            turn = algebra.multiply(algebra.conjugate(desired.vec8), reached.vec8)[:, :4]
            angle = 2 * np.arctan2(np.linalg.norm(turn[:, 1:], axis=1), np.abs(turn[:, 0]))
            distance = np.linalg.norm(desired.translation - reached.translation, axis=1)
            inside = ((q >= arm.limits.lower - 1e-9) & (q <= arm.limits.upper + 1e-9)).all(axis=1)
            return float((inside & (distance < TARGET[0]) & (angle < TARGET[1])).mean())

        def row(
            label: str, q: np.ndarray, seconds: np.ndarray, name: str = name, check: Callable = check
        ) -> None:
            times = [
                f"{value * 1e6:7.0f} µs" for value in (np.median(seconds), seconds.mean(), seconds.max())
            ]
            print(
                f"{name:12} {label:28} {check(q):8.1%} {times[0]:>10} {times[1]:>10} {times[2]:>10}",
                flush=True,
            )

        row("ours", *timed(lambda i, arm=arm, poses=poses: arm.solve(poses[i]).q, count))
        start = time.perf_counter()
        batch = arm.solve(poses).q
        row("ours, all poses in one call", batch, np.full(count, (time.perf_counter() - start) / count))
        fixed = arm.chain[:, :7]
        place = dqc.DualQuaternion.from_pose(fixed[:, :4], fixed[:, 4:])
        data = {
            "chain": arm.chain,
            "fixed": place.matrix(),
            "matrices": desired.matrix(),
            "lower": lower,
            "upper": upper,
            "middle": 0.5 * (lower + upper),
        }
        for label, worker, python, restarts in (
            ("Pink, one start", "pink", pink_python, 0),
            (f"Pink, {RESTARTS} restarts", "pink", pink_python, RESTARTS),
            ("Robotics Toolbox ik_LM", "rtb", rtb_python, 0),
        ):
            found = peer(worker, python, data, restarts)
            if isinstance(found, str):
                print(f"{name:12} {label:28} not run: {found}", flush=True)
            else:
                row(label, *found)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        work(*sys.argv[2:])
    else:
        parser = argparse.ArgumentParser(
            description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        parser.add_argument("robots", nargs="*", default=ROBOTS)
        parser.add_argument("--poses", type=int, default=1000)
        parser.add_argument("--seed", type=int, default=7)
        parser.add_argument("--pink", default=sys.executable, help="Python that has Pink and daqp")
        parser.add_argument("--rtb", default=sys.executable, help="Python that has Robotics Toolbox")
        given = parser.parse_args()
        main(given.robots, given.poses, given.seed, given.pink, given.rtb)
