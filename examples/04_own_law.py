"""A law of your own in plain Python, beside one of the library: the Jacobian's transpose in place of its inverse."""

import numpy as np

import dqcontrol as dqc


def jacobian_transpose(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """q̇ = k Jᵀ vec8(x_d − x); x_d is in sample[0:8]."""
    for i in range(out.shape[0]):
        out[i] = 0.0
        for k in range(8):
            out[i] += parameters[0] * pose_jacobian[k, i] * (sample[k] - pose[k])


arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
circle = dqc.references.Circle(arm.fkm(q), radius=0.05, duration=10.0)
laws = {
    "own: J transposed": dqc.laws.OwnLaw(function=jacobian_transpose, parameters=[50.0]),
    "K": dqc.laws.Proportional(gain=5.0),
}
records = {
    label: dqc.simulate(arm, circle, law, dqc.plants.Servo(), start=q, period=0.01)
    for label, law in laws.items()
}
for label, record in records.items():
    print(f"{label}: RMS error {dqc.measures.evaluate(record).position.rms:.1f} mm")
dqc.figures.compare_paths(records).savefig("04_own_law.png", dpi=150)
