"""Speed as ratios measured in one run: kinematics against Pinocchio, the compiled rollout, the import.

Absolute times depend on the machine and on what else it does; the ratios repeat within a few percent.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Mapping

import numpy as np
import pinocchio  # type: ignore[import-untyped]

import dqcontrol as dqc
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator
from dqcontrol.robots.load import example_urdfs

ROUNDS = 15
PANDA = "panda_description/urdf/panda.urdf"


def fastest(functions: Mapping[str, Callable[[], object]], repeat: int) -> dict[str, float]:
    """Return the least time of each function in µs, measured in turns."""
    best = dict.fromkeys(functions, np.inf)
    for _ in range(ROUNDS):
        for name, function in functions.items():
            start = time.perf_counter()
            for _ in range(repeat):
                function()
            best[name] = min(best[name], (time.perf_counter() - start) / repeat * 1e6)
    return best


def kinematics() -> None:
    arm = dqc.load_robot(f"example-robot-data:{PANDA}", tip_link="panda_hand")
    full = pinocchio.buildModelFromUrdf(str(example_urdfs()[PANDA]))
    model = pinocchio.buildReducedModel(full, [8, 9], pinocchio.neutral(full))
    data, frame = model.createData(), model.getFrameId("panda_hand")
    q = np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7])
    out = arm.kinematics(q)

    def by_pinocchio() -> None:
        pinocchio.computeJointJacobians(model, data, q)
        pinocchio.updateFramePlacement(model, data, frame)
        pinocchio.getFrameJacobian(model, data, frame, pinocchio.LOCAL_WORLD_ALIGNED)

    times = fastest({"ours": lambda: arm.kinematics(q, out), "pinocchio": by_pinocchio}, 5000)
    print(
        f"kinematics (pose, 8×7 and 6×7 Jacobians)      {times['ours']:8.2f} µs\n"
        f"Pinocchio (FK, joint and frame Jacobians)     {times['pinocchio']:8.2f} µs\n"
        f"ratio                                         {times['ours'] / times['pinocchio']:8.2f}    (≤ 1.0 wanted)"
    )


def whole_body() -> None:
    arm, body = dqc.load_robot("iiwa7"), dqc.load_robot("little-john")
    q, p = np.linspace(-1, 1, 7), np.linspace(-1, 1, 8)
    arm_out, body_out = arm.kinematics(q), body.kinematics(p)
    functions = {"arm": lambda: arm.kinematics(q, arm_out), "body": lambda: body.kinematics(p, body_out)}
    times = fastest(functions, 5000)
    print(
        f"kinematics, drive and 5 joints, 7 inputs      {times['body']:8.2f} µs\n"
        f"ratio to the same of 7 joints                 {times['body'] / times['arm']:8.2f}    (≤ 3.0 wanted)"
    )


def rollout() -> None:
    arm = dqc.load_robot("iiwa7")
    q0 = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    steps, dt = 20_000, 0.001
    circle = dqc.references.Circle(arm.fkm(q0), radius=0.07, duration=steps * dt, turns=4)
    samples = circle.samples(dt * np.arange(steps))
    law = dqc.laws.Proportional(gain=20.0).prepare(arm, circle, dt)
    run = {"rollout": lambda: close_loop(law, Integrator().start(arm, q0, dt, steps, 0), samples)}
    rate = steps / fastest(run, 1)["rollout"]
    print(f"compiled rollout, K on ideal joints, 7 joints {rate:8.2f} million steps/s (> 1 wanted)")


def importing() -> None:
    best = {"numpy, numba": np.inf, "dqcontrol": np.inf}
    for _ in range(7):
        for modules in best:
            start = time.perf_counter()
            subprocess.run([sys.executable, "-c", f"import {modules}"], check=True)
            best[modules] = min(best[modules], time.perf_counter() - start)
    extra = best["dqcontrol"] - best["numpy, numba"]
    print(f"import dqcontrol, beyond import numpy, numba  {extra:8.3f} s  (≤ 0.15 wanted)")


if __name__ == "__main__":
    kinematics()
    whole_body()
    rollout()
    importing()
