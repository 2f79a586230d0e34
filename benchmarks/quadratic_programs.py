"""One control step of Pink and of Mink, where they are installed. Both solve a quadratic program with joint limits."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import mujoco
import numpy as np
import pinocchio
from kinematics import PANDA, Q, as_mjcf
from measure import Ratio, medians

import dqcontrol as dqc
from dqcontrol.robots.load import example_urdfs

GAIN, PERIOD = 10.0, 0.01


def by_pink(goal: np.ndarray) -> Any:
    """Return a function that makes a step towards a pose matrix (4 × 4)."""
    import pink

    full = pinocchio.buildModelFromUrdf(str(example_urdfs()[PANDA]))
    model = pinocchio.buildReducedModel(full, [8, 9], pinocchio.neutral(full))
    configuration = pink.Configuration(model, model.createData(), Q)
    task = pink.tasks.FrameTask("panda_hand", position_cost=1.0, orientation_cost=1.0, gain=GAIN * PERIOD)
    task.set_target(pinocchio.SE3(goal))

    def step() -> np.ndarray:
        configuration.update(Q)
        return pink.solve_ik(configuration, [task], PERIOD, solver="daqp")

    return step


def by_mink(goal: np.ndarray, arm: dqc.Robot) -> Any:
    """Return a function that makes a step towards a pose matrix (4 × 4)."""
    import mink

    model = mujoco.MjModel.from_xml_string(as_mjcf(arm, limited=True))
    configuration = mink.Configuration(model, Q)
    task = mink.FrameTask("hand", "body", position_cost=1.0, orientation_cost=1.0, gain=GAIN * PERIOD)
    task.set_target(mink.SE3.from_matrix(goal))

    def step() -> np.ndarray:
        configuration.update(Q)
        return mink.solve_ik(configuration, [task], PERIOD, solver="daqp")

    return step


def ratios(short: bool) -> list[Ratio]:
    """Return our step of law K with the damped inverse against theirs."""
    arm = dqc.load_robot(f"example-robot-data:{PANDA}", tip_link="panda_hand")
    pose = dqc.DualQuaternion(arm.fkm(Q + 0.02))
    goal, sample, out = np.asarray(pose.matrix()), dqc.Sample(pose.vec8), np.empty(7)
    law = dqc.laws.Proportional(gain=GAIN, inverse=dqc.laws.DampedInverse(damping=0.01))
    prepared = law.prepare(arm, None, PERIOD)
    state = prepared.initial_state(Q)
    ours = prepared.command(Q, sample, state).copy()
    functions: dict[str, Any] = {"ours": lambda: prepared.command(Q, sample, state, out)}
    if find_spec("pink"):
        functions["Pink, one step"] = by_pink(goal)
    if find_spec("mink"):
        functions["Mink, one step"] = by_mink(goal, arm)
    for name, function in functions.items():  # near the goal all go the same way, at nearly the same speed
        step = np.asarray(function())
        if not np.linalg.norm(step - ours) < 0.25 * np.linalg.norm(ours):
            raise SystemExit(f"{name}: differs, {step} against {ours}")
    t = medians(functions, 500, 3 if short else 15)
    return [
        Ratio("K, damped", t["ours"], "µs", f"{name} (a quadratic program)", t[name], "≤ 0.05")
        for name in functions
        if name != "ours"
    ]
