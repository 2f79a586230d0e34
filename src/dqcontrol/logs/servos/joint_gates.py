"""One joint of a log: whether its servo can be told at all, its fit, and how well that holds on the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.logs.servos.encoder_noise import QUANTUM, noise_of, resolution_of
from dqcontrol.logs.servos.joint_fit import (
    LEAST_LAG,
    MOST_DELAY,
    MOST_LAG,
    NORMAL_95,
    Fit,
    Segment,
    fit,
    fit_at,
    predicted,
    squares_at,
)

Interval = tuple[float, float]

_IDLE = 1e-6  # rad or m
_EXCITED = 8.0  # times the noise or the encoder's step, least range of a command
_STUCK = 0.05  # of the command's range, least range of what moves
_FAR = 6.0  # standard deviations
_UNEXPLAINED = 2.5  # times the noise, a residual that may hide a clamp
_CLAMPED = 0.5  # of the sum of squares that a clamp leaves
_TIED = 0.99  # correlation of lag and delay that lets the smallest flaw of the model shift one into the other
_TRADED, _UNSURE = 0.9, 0.15  # correlation of lag and delay; share of the lag that its standard error is
_SAME = 10.0  # times the variance, a sum of squares that is no worse
_POOR = 0.15  # of what moved, a residual at which no servo of this kind explains the log
_BEGIN = 0.7  # of a joint's path is fitted, the rest checks
_SURE = 3.0  # standard errors, of a sag that is there
_REGULAR = 1.3  # times the floor: a residual that is more than noise


@dataclass(frozen=True)
class JointIdentification:
    """What a log tells of one joint's servo; NaN where it tells nothing.

    Attributes
    ----------
    name
        Of the joint.
    status
        ``"fitted"`` or ``"refused"``.
    reason
        Why it was refused; empty otherwise.
    lag, delay
        Time constant τ and delay D from a command to its effect, s.
    lag_interval, delay_interval, gain_interval, sag_interval
        95 %.
    gain
        Share of a commanded move that is made.
    offset
        Mean of measured less commanded positions apart from lag, rad or m.
    sag
        By how much gravity pulls the joint down, rad/(N·m) or m/N; NaN if the robot has no masses or the joint no load
        that varies.
    resolution
        Step of the encoder, rad or m; 0 if none is seen.
    noise
        Standard deviation of the measured position besides the steps, rad or m.
    correlation
        Of the estimates of lag and delay: near −1 only their sum is sure.
    residual
        RMS of what the model leaves where it was not fitted, rad or m; of ambiguous joints, where it was.
    floor
        What noise and steps of the encoder alone would leave, rad or m.
    notes
        What else should be known.
    """

    name: str
    status: Literal["fitted", "refused"] = "refused"
    reason: str = ""
    lag: float = math.nan
    lag_interval: Interval = (math.nan, math.nan)
    delay: float = math.nan
    delay_interval: Interval = (math.nan, math.nan)
    gain: float = math.nan
    gain_interval: Interval = (math.nan, math.nan)
    offset: float = math.nan
    sag: float = math.nan
    sag_interval: Interval = (math.nan, math.nan)
    resolution: float = 0.0
    noise: float = math.nan
    correlation: float = math.nan
    residual: float = math.nan
    floor: float = math.nan
    notes: tuple[str, ...] = ()


class _Clamp(NamedTuple):
    """Targets beyond ``lower`` … ``upper`` have no effect; in such a share of the samples."""

    lower: float
    upper: float
    share: float


def identify_joint(name: str, unit: str, segments: list[Segment], period: float) -> JointIdentification:
    """Return what some segments of a log tell of a joint.

    Parameters
    ----------
    name
        Of the joint.
    unit
        ``"rad"`` or ``"m"``.
    segments
        Its parts without a break.
    period
        Median time between commands, s.
    """
    positions = np.concatenate([each.positions for each in segments])
    targets = np.concatenate([each.target.values for each in segments])
    resolution = resolution_of(positions)
    noise = max(noise_of(positions, 0.0), resolution)
    bare = JointIdentification(name, resolution=resolution)
    asked, moved = float(np.ptp(targets)), float(np.ptp(positions))
    if asked < _IDLE:
        return replace(bare, reason="idle: its command never changes")
    if asked < _EXCITED * noise:
        return replace(
            bare,
            reason=f"not excited: its command moves by {asked:.3g} {unit}, encoder and noise by {noise:.3g}",
        )
    if moved < _STUCK * asked:
        return replace(
            bare, reason=f"stuck: it moves by {moved:.3g} {unit} where {asked:.3g} are commanded (a brake?)"
        )
    found = fit(segments, period)
    kept, dropped = _without_outliers(segments, found, resolution)
    if dropped:
        found = fit(kept, period, near=found)
    floor = noise_of(found.residual, resolution)
    if found.rms > _UNEXPLAINED * floor and (clamp := _clamp(kept, found)) is not None:
        return replace(
            bare,
            reason=f"clamped: targets beyond {clamp.lower:.4g} … {clamp.upper:.4g} {unit} have no effect "
            f"({100 * clamp.share:.1f} % of the samples); log a motion that stays inside",
        )
    return _judged(bare, unit, kept, found, period, floor, dropped)


def _judged(
    bare: JointIdentification,
    unit: str,
    segments: list[Segment],
    found: Fit,
    period: float,
    floor: float,
    dropped: int,
) -> JointIdentification:
    """Return the fit of a joint, or why it is none."""
    spread = float(np.std(np.concatenate([each.positions for each in segments])))
    if found.lag > 0.98 * MOST_LAG or found.delay > 0.998 * MOST_DELAY:
        what = f"lag of {MOST_LAG:g} s" if found.lag > 0.98 * MOST_LAG else f"delay of {MOST_DELAY:g} s"
        return replace(bare, reason=f"beyond what is searched: a {what} or more fits best")
    if found.rms > _POOR * spread:
        return replace(
            bare,
            reason=f"not explained by a lag and a delay: they leave {found.rms:.3g} {unit} RMS of the "
            f"{spread:.3g} that it moved",
        )
    sag, sag_interval = math.nan, (math.nan, math.nan)
    if segments[0].torque is not None:
        sag, sag_interval = found.sag, _interval(found.sag, found.error(3))
        if abs(found.sag) < _SURE * found.error(3):
            sag, segments = 0.0, [each._replace(torque=None) for each in segments]
            found = fit(segments, period, near=found)
    lag_error, delay_error = found.error(0), found.error(1)
    no_lag = found.lag <= LEAST_LAG * 1.01
    unsure = abs(found.correlation) > _TRADED and lag_error > _UNSURE * found.lag
    if found.lag < period / 2:  # answers are steps then, whose slopes tell nothing: is a longer lag as good?
        longer = squares_at(
            segments,
            found.lag + period,
            found.delay + period * np.linspace(-2, 1, 13).clip(-found.delay / period),
        )
        unsure = longer < (1 + _SAME / len(found.residual)) * float(np.sum(found.residual**2))
    # What the model lacks shifts one into the other, and intervals hold for the model alone.
    tied = abs(found.correlation) > _TIED and found.rms > _REGULAR * floor
    unsure = unsure or tied or not delay_error < period
    if unsure:
        both = found.lag + found.delay
        return replace(
            bare,
            reason=f"ambiguous: lag and delay trade off (correlation {found.correlation:.4f}), only their sum is "
            f"sure, {1e3 * both:.3g} ms; log a faster motion",
            correlation=found.correlation,
            residual=found.rms,
            floor=floor,
        )
    notes = []
    if dropped:
        notes.append(f"{dropped} samples far off were left out")
    residual = _checked(segments, found, period)
    noise = math.sqrt(max(min(found.rms, floor) ** 2 - (bare.resolution * QUANTUM) ** 2, 0.0))
    if found.rms > _REGULAR * floor:
        notes.append(
            f"{found.rms / floor:.2g} times as much is left as by noise and encoder: a servo of second order, "
            "friction, play or other joints"
        )
    return replace(
        bare,
        status="fitted",
        lag=0.0 if no_lag else found.lag,
        lag_interval=_interval(found.lag, lag_error, least=0.0),
        delay=found.delay,
        delay_interval=_interval(found.delay, delay_error, least=0.0),
        gain=found.gain,
        gain_interval=_interval(found.gain, found.error(2)),
        offset=found.offset,
        sag=sag,
        sag_interval=sag_interval,
        noise=noise,
        correlation=found.correlation,
        residual=residual,
        floor=floor,
        notes=tuple(notes),
    )


def _interval(value: float, error: float, least: float = -math.inf) -> Interval:
    return max(value - NORMAL_95 * error, least), value + NORMAL_95 * error


def _without_outliers(segments: list[Segment], found: Fit, resolution: float) -> tuple[list[Segment], int]:
    """Return the segments without single samples far off, and how many these are; runs of them are no outliers."""
    sizes = np.abs(found.residual)
    usual = max(float(np.median(sizes)) / 0.6745, resolution * QUANTUM)
    far = sizes > _FAR * usual + resolution / 2
    beside = np.convolve(far, np.ones(5), mode="same") > 2  # three of five neighbours: no single samples
    far &= ~beside
    if not far.any():
        return segments, 0
    parts = np.split(~far, np.cumsum([len(each.times) for each in segments])[:-1])
    return [each.chosen(part) for each, part in zip(segments, parts, strict=True)], int(far.sum())


def _clamp(segments: list[Segment], found: Fit) -> _Clamp | None:
    """Return the limits of the targets that explain what is left, if they explain at least half of it."""
    positions = np.concatenate([each.positions for each in segments])
    targets = np.concatenate([each.target.values for each in segments])
    best = float(np.sum(found.residual**2))
    first = best
    ends = [float(targets.min()), float(targets.max())]
    lag, delay = found.lag, found.delay
    for _ in range(2):
        for side, extreme in enumerate((float(positions.min()), float(positions.max()))):
            span = float(np.ptp(targets))
            for trial in extreme + span * np.linspace(-0.06, 0.06, 13):
                limits = [trial, ends[1]] if side == 0 else [ends[0], trial]
                if limits[0] >= limits[1]:
                    continue
                again = fit_at(_limited(segments, *limits), lag, delay)
                cost = float(np.sum(again.residual**2))
                if cost < 0.98 * best:
                    best, ends = cost, limits
    if best > _CLAMPED * first:
        return None
    over = np.concatenate(
        [(each.target.values < ends[0]) | (each.target.values > ends[1]) for each in segments]
    )
    return _Clamp(ends[0], ends[1], float(over.mean()))


def _limited(segments: list[Segment], lower: float, upper: float) -> list[Segment]:
    return [
        each._replace(target=each.target._replace(values=np.clip(each.target.values, lower, upper)))
        for each in segments
    ]


def _checked(segments: list[Segment], found: Fit, period: float) -> float:
    """Return the RMS that a fit of the first 70 % of the joint's path leaves on the rest; NaN if nothing is left."""
    paths = [np.concatenate([[0.0], np.cumsum(np.abs(np.diff(each.target.values)))]) for each in segments]
    wanted, before = _BEGIN * sum(float(each[-1]) for each in paths), 0.0
    begun, rest = list[Segment](), list[tuple[Segment, NDArray[np.bool_]]]()
    for each, path in zip(segments, paths, strict=True):
        until = each.target.begins[min(np.searchsorted(path, wanted - before), len(path) - 1)]
        early = each.times <= until
        if before + path[-1] <= wanted:
            early[:] = True
        elif before >= wanted:
            early[:] = False
        before += float(path[-1])
        begun += [each.chosen(early)] if early.sum() > 20 else []
        rest += [(each, ~early)] if (~early).sum() > 20 else []
    if not begun or not rest:
        return math.nan
    from_begin = fit(begun, period, near=found)
    left = [(each.positions - predicted(from_begin, each))[late] for each, late in rest]
    return float(np.sqrt(np.mean(np.concatenate([each - each.mean() for each in left]) ** 2)))
