"""One command of a law, called from Python, against DQ Robotics' controllers; and the laws against each other."""

from __future__ import annotations

from functools import partial
from typing import Any

import dqrobotics as dqr
import numpy as np
from dqrobotics.robot_control import ControlObjective, DQ_PseudoinverseController
from kinematics import check, dq_robotics_arm, our_arm
from laws import LAWS
from measure import Ratio, medians
from msgspec.structs import replace

import dqcontrol as dqc
from dqcontrol import laws
from dqcontrol_theses import variants

Q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0.1])
GAIN, DAMPING, PERIOD = 10.0, 0.01, 0.008


def their_controller(arm: Any, damping: float) -> Any:
    """Return DQ Robotics' controller of the pose."""
    controller = DQ_PseudoinverseController(arm)
    controller.set_control_objective(ControlObjective.Pose)
    controller.set_gain(GAIN)
    controller.set_damping(damping)
    return controller


def ratios(short: bool) -> list[Ratio]:
    """Return all lines: law K with both inverses, and every other law with the damped one."""
    arm, theirs = our_arm(), dq_robotics_arm()
    sample, circle = (
        dqc.Sample(arm.fkm(Q + 0.1)),
        dqc.references.Circle(arm.fkm(Q), radius=0.07, duration=24.0),
    )
    damped, undamped = their_controller(theirs, DAMPING), their_controller(theirs, 0.0)
    desired = dqr.vec8(dqr.DQ(sample.pose))
    functions: dict[str, Any] = {
        "damped": lambda: damped.compute_setpoint_control_signal(Q, desired),
        "pinv": lambda: undamped.compute_setpoint_control_signal(Q, desired),
    }
    inverses = {"damped": laws.DampedInverse(damping=DAMPING), "filtered": laws.FilteredInverse()}
    chosen = {f"K, {name}": laws.Proportional(gain=GAIN, inverse=i) for name, i in inverses.items()}
    for name, law in LAWS.items():
        if name not in ("K", "open loop"):
            chosen[name] = replace(law, inverse=inverses["damped"])
    out = np.empty(7)
    for name, law in chosen.items():
        prepared = law.prepare(arm, circle, PERIOD)
        functions[name] = partial(prepared.command, Q, sample, prepared.initial_state(Q), out)
    # Theirs feeds back x − x_d, the classic error, and damps in another measure: without damping both are the same.
    exact = laws.FilteredInverse(growth=0.0)
    classic = variants.ClassicProportional(gain=GAIN, inverse=exact).prepare(arm, None, PERIOD)
    check(functions["pinv"](), classic.command(Q, sample, classic.initial_state(Q)))
    t = medians(functions, 1000, 3 if short else 15)
    found = [
        Ratio("K, damped", t["K, damped"], "µs", "DQ Robotics' damped controller", t["damped"], "≤ 0.30"),
        Ratio(
            "K, filtered inverse",
            t["K, filtered"],
            "µs",
            "DQ Robotics' undamped controller",
            t["pinv"],
            "≤ 0.45",
        ),
    ]
    others = [name for name in chosen if not name.startswith("K, ")]
    return found + [
        Ratio(name, t[name], "µs", "DQ Robotics' damped controller", t["damped"], "≤ 0.40") for name in others
    ]
