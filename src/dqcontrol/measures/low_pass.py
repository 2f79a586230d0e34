"""A low pass without delay, for derivatives of measured positions."""

from __future__ import annotations

import numpy as np

from dqcontrol.arrays import Array

_NYQUIST_SHARE = 0.9  # a cut-off above it leaves what there is
_MOST = 10  # times as many points as samples between which gaps are joined


def low_passed(time: Array, values: Array, cutoff: float) -> Array:
    """Return values without what is faster than a cut-off: Butterworth of order two, forwards and backwards.

    The samples are joined linearly onto equal steps of their median period, filtered, and read at their own times.

    Parameters
    ----------
    time
        Shape (N,), s, increasing.
    values
        Shape (N, columns).
    cutoff
        Where two passes leave half of an amplitude, Hz.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.measures.low_pass import low_passed
    >>> time = np.arange(0, 2, 0.005)
    >>> slow, fast = np.sin(2 * np.pi * time)[:, None], 0.1 * np.sin(2 * np.pi * 80 * time)[:, None]
    >>> bool(np.abs(low_passed(time, slow + fast, 10.0) - slow)[50:-50].max() < 0.003)
    True
    """
    from scipy.signal import (  # takes as long to load as all of ours: only where it is used
        butter,
        sosfiltfilt,
    )

    if len(time) < 4:
        return values
    period = max(float(np.median(np.diff(time))), float(time[-1] - time[0]) / (_MOST * len(time)))
    if cutoff >= _NYQUIST_SHARE * 0.5 / period:
        return values
    even = np.arange(time[0], time[-1] + period / 2, period)
    sections = butter(2, cutoff, fs=1 / period, output="sos")
    joined = np.column_stack([np.interp(even, time, column) for column in values.T])
    reach = min(len(even) - 1, int(np.ceil(1 / (cutoff * period))))
    smooth = np.asarray(sosfiltfilt(sections, joined, axis=0, padlen=reach))
    return np.column_stack([np.interp(time, even, column) for column in smooth.T])
