"""Compliant arms in physics: speed against real time on one core, energy kept, static sag against its equation.

Speeds are in processor time, of one core. They include the whole loop: law K every 8 ms, the joint
controllers at 1 kHz, MuJoCo and the record.
"""

from __future__ import annotations

import time

import numpy as np

import dqcontrol as dqc
from dqcontrol.plants import CompliantPlant
from dqcontrol.plants.compliant.controller_file import load_controllers
from dqcontrol.plants.compliant.elastic_model import TICK, Actuation, elastic_model
from dqcontrol.plants.compliant.running_compliant import assemble
from dqcontrol.robots.files.mjcf import import_mujoco

ARMS = {
    "meka-a2": np.array([0, np.pi / 5, 0, np.pi / 2, 0, np.pi / 5, 0]),
    "iiwa7": np.array([0, 0.6, 0, 1.6, 0, 0.6, 0]),
}
ROUNDS = 5
SECONDS = 12.0


def speed(name: str, **parameters: object) -> float:
    """Return simulated seconds a second, the best of several runs."""
    arm, q0 = dqc.load_robot(name), ARMS[name]
    circle = dqc.references.Circle(arm.fkm(q0), radius=0.07, duration=SECONDS, plane="xy")
    law, plant = dqc.laws.Proportional(gain=3.0), CompliantPlant(**parameters)  # type: ignore[arg-type]
    best = np.inf
    for _ in range(ROUNDS):
        start = time.process_time()
        dqc.simulate(arm, circle, law, plant, q0, period=0.008)
        best = min(best, time.process_time() - start)
    return SECONDS / best


def energy_drift(name: str, springs: str, hand: bool) -> tuple[float, int]:
    """Return the change of energy in 10 s of free undamped motion over the peak kinetic energy, and steps a tick."""
    mujoco = import_mujoco()
    arm, q0 = dqc.load_robot(name), ARMS[name]
    file = load_controllers(arm)
    real = file.actuation(springs)
    free = Actuation(
        real.rotor_inertia, 0 * real.friction, real.stiffness, 0 * real.damping, 0 * real.friction
    )
    model = elastic_model(arm, free, hand=file.hand(hand), accurate=True, stops=False)
    steps = assemble(CompliantPlant(springs=springs, hand=hand, accurate=True), arm, q0, TICK).steps
    model.opt.timestep = TICK / steps
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    data.qpos[:7], data.qpos[7:] = q0, q0[real.elastic]
    mujoco.mj_forward(model, data)
    before, peak, drift = data.energy.sum(), 0.0, 0.0
    for _ in range(10_000):
        mujoco.mj_step(model, data, steps)
        mujoco.mj_forward(model, data)
        peak, drift = max(peak, data.energy[1]), max(drift, abs(data.energy.sum() - before))
    return drift / peak, steps


def static_sag() -> float:
    """Return the largest relative difference between the Meka's sag in THETA_GC and its equation (joints 2 and 3)."""
    arm = dqc.load_robot("meka-a2")
    file = load_controllers(arm)
    gain = file.column("motor", "torque_constant") * file.column("torque_loop", "k_p")
    ratio, k_p = gain / (1 + gain), file.column("position_loop", "k_p")
    live = CompliantPlant(gravity_factor=0.7).start(arm, ARMS["meka-a2"], 0.008, 0, 0)
    for k in range(750):
        live.step(np.full(7, 0.1) if k < 125 else np.zeros(7))
    rows = []
    for _ in range(125):
        live.step(np.zeros(7))
        rows.append(live.q.copy())
    q = np.mean(rows, axis=0)
    load = arm.gravity_forces(q, (0, 0, -9.809))
    sag = (load / ratio - 0.7 * load) / k_p
    return float(np.abs((live.reference - q) / sag - 1)[1:3].max())


def main() -> None:
    """Print all figures."""
    cases = (
        ("meka-a2", {}, 60),
        ("meka-a2", {"hand": True, "encoder_noise": 1e-4}, 60),
        ("meka-a2", {"accurate": True}, 30),
        ("meka-a2", {"hand": True, "accurate": True}, 30),
        ("iiwa7", {}, 60),
    )
    for name, parameters, wanted in cases:
        text = ", ".join(f"{key}: {value}" for key, value in parameters.items())
        print(f"{name} {text:40s} {speed(name, **parameters):6.0f} × real time  (> {wanted} wanted)")
    for name, springs, hand in (
        ("meka-a2", "default", False),
        ("meka-a2", "default", True),
        ("meka-a2", "lower-bound", True),
        ("iiwa7", "default", False),
        ("iiwa7", "elastic", False),
    ):
        drift, steps = energy_drift(name, springs, hand)
        text = f"{name} {springs}{', hand' * hand}, {steps} steps/ms"
        print(f"energy kept, {text:40s} {100 * drift:9.2g} %  (< 0.1 wanted)")
    print(f"static sag of THETA_GC against its equation          {100 * static_sag():9.2g} %  (< 2 wanted)")


if __name__ == "__main__":
    main()
