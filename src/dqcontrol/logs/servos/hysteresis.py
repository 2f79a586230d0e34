"""Play between a servo and its joint, or friction that acts like it: the joint stays behind on either side."""

from __future__ import annotations

import math

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE, kernel, types
from dqcontrol.logs.servos.encoder_noise import QUANTUM
from dqcontrol.logs.servos.joint_fit import Fit, Segment, sandwich, solved

_TRIED = (0.5, 1.0, 2.0, 4.0)  # of what is left, half widths of a play
_SURE = 5.0  # standard errors
_LEAST = 1e-4  # rad or m
_WIDTHS = (0.3, 0.5)  # of the encoder's step and of its noise; less is none


@kernel(types.void(READ, types.float64, WRITE))
def _play_position(values, half_width, out):
    """Write where in a play of ± half_width each value is, −1 … 1."""
    middle = values[0]
    for k in range(values.shape[0]):
        middle = min(max(middle, values[k] - half_width), values[k] + half_width)
        out[k] = (values[k] - middle) / half_width


def hysteresis(
    segments: list[Segment], found: Fit, resolution: float, about: float = 0.0
) -> tuple[float, list[Segment]]:
    """Return half the width of the play that a fit leaves, 0 if none is sure, and the segments without it.

    What is left is compared with the position of the fitted output in a play, which is a share of a dead band, too.
    ``about`` is what that half width was found to be before; 0 if it is not known.
    """
    usual = max(found.rms, resolution * QUANTUM)
    columns = solved(segments, found.kind, found.values)
    jacobian = np.column_stack([columns.slopes, columns.columns])
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    best: tuple[float, float, Array, Array] | None = None
    for half_width in (about,) if about else tuple(usual * each for each in _TRIED):
        place = _place(segments, found.output, half_width)
        alone = place - basis @ (basis.T @ place)
        share = float(alone @ alone)
        if share > 1e-6 * len(place):
            factor = float(alone @ columns.residual) / share
            if best is None or factor**2 * share > best[0]:
                best = factor**2 * share, factor, place, alone
    if best is None:
        return 0.0, segments
    _, factor, place, alone = best
    covariance = sandwich(np.column_stack([jacobian, place]), columns.residual - factor * alone)
    least = max(_WIDTHS[0] * resolution, _WIDTHS[1] * _smooth_noise(columns.residual), _LEAST)
    if -factor < max(_SURE * math.sqrt(max(covariance[-1, -1], 0.0)), least):
        return 0.0, segments
    parts = np.split(place, np.cumsum([len(each.times) for each in segments])[:-1])
    mended = [
        each._replace(positions=each.positions - factor * part)
        for each, part in zip(segments, parts, strict=True)
    ]
    return -factor, mended


def _place(segments: list[Segment], output: Array, half_width: float) -> Array:
    """Return where in a play the output is, −1 … 1."""
    place = np.zeros(len(output))
    first = 0
    for each in segments:
        rows = slice(first, first + len(each.times))
        _play_position(np.ascontiguousarray(output[rows]), half_width, place[rows])
        first = rows.stop
    return place


def _smooth_noise(residual: Array) -> float:
    """Return the noise of neighbouring samples."""
    return float(np.median(np.abs(np.diff(residual)))) / (0.6745 * math.sqrt(2))
