"""Many random logs of one joint each, identified; run it for the table of docs/identify.md."""

import sys
from pathlib import Path

import numpy as np
from servo_simulator import answer, encoder, multisine

from dqcontrol.logs.servos.joint_gates import identify_joint
from dqcontrol.logs.servos.replay import CommandedLog

RESOLUTIONS = (0.0, 3.8e-4, 1.5e-3)  # rad
BAD = ("idle", "clamped", "ambiguous")


def one(rng, case, bad=None):
    """Return what is found of a random joint, and its lag, delay and period."""
    period = rng.uniform(0.004, 0.01)
    count = round(20 / period)
    time = np.arange(count) * period + rng.uniform(-0.1, 0.1, count) * period
    lag, delay = np.exp(rng.uniform(np.log(0.02), np.log(0.2))), rng.uniform(0.0, 0.05)
    target = multisine(rng, time, lines=(0.2, 4.0))
    resolution = RESOLUTIONS[case % 3]
    if bad == "idle":
        target[:] = 0.2
    if bad == "ambiguous":
        target, resolution = 0.02 * np.sin(2 * np.pi * 0.03 * time), 0.0
    reached = np.clip(target, -np.inf, 0.6 * target.max()) if bad == "clamped" else target
    noise = 1e-3 if bad == "ambiguous" else 5e-5 if resolution else 2e-4
    gain = rng.uniform(0.98, 1.02)
    seen = encoder(rng, gain * answer(time, reached, lag, delay, time), resolution, noise)
    kept = np.sort(rng.permutation(count)[: round(rng.uniform(0.95, 1.0) * count)])
    log = CommandedLog(Path("log"), time[kept], seen[kept][:, None], time[kept], target[kept][:, None], True)
    return identify_joint("joint", "rad", log.segments(0, "positions", None), log.period), lag, delay, period


def study(count, seed):
    """Return the errors, the coverage of the intervals and the refusals of many logs."""
    rng, rows, refused = np.random.default_rng(seed), [], 0
    for case in range(count):
        found, lag, delay, period = one(rng, case)
        if found.status == "refused":
            refused += 1
            continue
        inside = [
            ends[0] <= true <= ends[1]
            for ends, true in ((found.lag_interval, lag), (found.delay_interval, delay))
        ]
        rows.append(
            [found.lag / lag - 1, (found.delay - delay) / period, found.residual / found.floor, *inside]
        )
    bad = [one(rng, case, BAD[case % 3])[0] for case in range(count // 4)]
    table = np.array(rows, dtype=float)
    return {
        "lags within 2 %": float(np.mean(np.abs(table[:, 0]) < 0.02)),
        "lag error, largest": float(np.abs(table[:, 0]).max()),
        "lag error, RMS": float(np.sqrt(np.mean(table[:, 0] ** 2))),
        "delay error, largest": float(np.abs(table[:, 1]).max()),
        "delay error, RMS": float(np.sqrt(np.mean(table[:, 1] ** 2))),
        "left over the floor, largest": float(table[:, 2].max()),
        "coverage of lag": float(table[:, 3].mean()),
        "coverage of delay": float(table[:, 4].mean()),
        "good refused": refused,
        "bad fitted": sum(each.status == "fitted" for each in bad),
    }


if __name__ == "__main__":
    for name, value in study(int(sys.argv[1]), int(sys.argv[2])).items():
        print(f"{name}: {value:.4g}")
