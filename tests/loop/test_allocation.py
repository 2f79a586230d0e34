"""A compiled step allocates nothing, counted by Numba's own runtime over 100 000 steps."""

import json
import os
import subprocess
import sys

import pytest

SCRIPT = """
import json
import numpy as np
import dqcontrol as dqc
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop import close_loop
from numba.core.runtime import rtsys

def allocating(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    error = np.zeros(8)
    for k in range(8):
        error[k] = sample[k] - pose[k]
    for i in range(out.shape[0]):
        out[i] = 0.0
        for k in range(8):
            out[i] += pose_jacobian[k, i] * error[k]

arm, start, steps = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0]), 100_000
circle = dqc.references.Circle(arm.fkm(start), radius=0.05, duration=0.001 * steps)
samples = circle.samples(0.001 * np.arange(steps))
servo = dqc.plants.Servo(time_constant=0.02, delay=0.002, sag=0.5, stiffness=100.0, encoder_resolution=1e-4)
clamped = CommandLimits(position=ModifiedClamping(), velocity=True)

def count(law, plant, limits=None):
    law = law.prepare(arm, circle, 0.001, limits)
    close_loop(law, plant.start(arm, start, 0.001, 10, 0), samples[:10])
    live = plant.start(arm, start, 0.001, steps, 0)
    before = rtsys.get_allocation_stats()
    done = len(close_loop(law, live, samples).q)
    assert done == steps, done
    return rtsys.get_allocation_stats().alloc - before.alloc

laws = dqc.laws
print(json.dumps({
    "K, ideal": count(laws.Proportional(gain=5.0), dqc.plants.Integrator()),
    "K+FF, servo, limits": count(laws.ProportionalFeedforward(gain=5.0), servo, clamped),
    "H-infinity, servo": count(laws.HInfinity(orientation_gain=5.0, translation_gain=5.0), servo),
    "LQR-DQ, ideal": count(laws.LinearQuadraticDQ(error_weight=25.0, control_weight=1.0), dqc.plants.Integrator()),
    "allocating": count(laws.OwnLaw(function=allocating), dqc.plants.Integrator()),
}))
"""


@pytest.mark.slow
def test_a_step_allocates_nothing_and_an_allocating_law_is_caught():
    environment = dict(os.environ, NUMBA_NRT_STATS="1")
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    counts = json.loads(done.stdout.splitlines()[-1])
    assert counts.pop("allocating") >= 100_000
    # What is left are the arrays that the call itself wraps, a fixed number however many steps there are.
    assert all(count < 100 for count in counts.values()), counts
