"""Joints with lag, delay, gain, sag and encoders, written without any of the package's plants or kernels."""

from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.signal import cont2discrete, lfilter

GRID = 1e-3  # s, of the torque


def multisine(rng, time, amplitude=0.4, speed=1.0, acceleration=12.0, lines=(0.1, 6.0)):
    """Return a random motion that begins and ends at rest, within limits of position, speed and acceleration."""
    frequency = np.geomspace(*lines, 18) * rng.uniform(0.97, 1.03, 18)
    phase, weight = rng.uniform(0, 2 * np.pi, 18), frequency**-1.2
    angle = 2 * np.pi * frequency * time[:, None] + phase
    swell = np.clip(np.minimum(time, time[-1] - time) / 0.5, 0, 1)
    motion = (3 * swell**2 - 2 * swell**3) * (np.sin(angle) @ weight)
    step = np.median(np.diff(time))
    rates = np.diff(motion) / step
    largest = np.abs(motion).max(), np.abs(rates).max(), np.abs(np.diff(rates)).max() / step
    return motion * min(np.array([amplitude, speed, acceleration]) / largest)


def answer(edges, values, lag, delay, times):
    """Return what a lag does whose target is held from each edge to the next, a delay later; event by event."""
    out, x, now, k = np.zeros(len(times)), values[0], min(edges[0], times[0]) - 1.0, -1
    for j, time in enumerate(times):
        while k + 1 < len(edges) and edges[k + 1] + delay <= time:
            until = edges[k + 1] + delay
            goal = values[max(k, 0)]
            x, now, k = goal + (x - goal) * np.exp(-(until - now) / lag), until, k + 1
        goal = values[max(k, 0)]
        x, now = goal + (x - goal) * np.exp(-(time - now) / lag), time
        out[j] = x
    return out


def lagged(grid_values, lag):
    """Return what a lag does to values on the grid, joined by straight lines, from rest."""
    system = tuple(np.array([[value]]) for value in (-1 / lag, 1 / lag, 1.0, 0.0))
    discrete: Any = cont2discrete(system, GRID, method="foh")
    a, b, c, d = discrete[:4]
    begin = grid_values[0]
    numerator = [float(d[0, 0]), float(c[0, 0] * b[0, 0] - a[0, 0] * d[0, 0])]
    return begin + lfilter(numerator, [1.0, -float(a[0, 0])], grid_values - begin)


def encoder(rng, positions, resolution, noise):
    """Return what an encoder gives."""
    seen = positions + rng.normal(0, noise, positions.shape) if noise else positions.copy()
    return resolution * np.round(seen / resolution) if resolution else seen


def write_log(path, time, targets, positions, *, what="target"):
    """Write a table of n joints."""
    n = positions.shape[1]
    names = ["time", *(f"q{i + 1}" for i in range(n))]
    names += [f"r{i + 1}" if what == "target" else f"u{i + 1}" for i in range(n)]
    table = np.column_stack([time, positions, targets])
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.10g")
    return path


def second_order_answer(edges, values, bandwidth, damping, delay, times):
    """Return what a servo of second order does whose target is held from each edge to the next, a delay later."""
    system = np.array([[0.0, 1.0], [-(bandwidth**2), -2 * damping * bandwidth]])
    out, state, now, k = np.zeros(len(times)), np.array([values[0], 0.0]), min(edges[0], times[0]) - 1.0, -1
    for j, time in enumerate(times):
        while True:
            is_step = k + 1 < len(edges) and edges[k + 1] + delay <= time
            until = edges[k + 1] + delay if is_step else time
            goal = np.array([values[max(k, 0)], 0.0])
            state, now = goal + expm(system * (until - now)) @ (state - goal), until
            if not is_step:
                break
            k += 1
        out[j] = state[0]
    return out


def played(positions, half_width):
    """Return what a joint does that stays behind in a play of ± half_width."""
    out, at = np.zeros(len(positions)), positions[0]
    for k, position in enumerate(positions):
        at = min(max(at, position - half_width), position + half_width)
        out[k] = at
    return out
