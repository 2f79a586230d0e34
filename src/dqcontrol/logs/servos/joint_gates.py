"""One joint of a log: whether its servo can be told at all, its fit, and how well that holds on the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.logs.servos import joint_fit
from dqcontrol.logs.servos.encoder_cells import refined
from dqcontrol.logs.servos.hysteresis import fit_with_play, half_play
from dqcontrol.logs.servos.servo_orders import LEAST_LAG, MOST_DELAY, MOST_LAG

Interval = tuple[float, float]

_IDLE = 1e-6  # rad or m
_EXCITED = 8.0  # times the noise or the encoder's step, least range of a command
_STUCK = 0.05  # of the command's range, least range of what moves
_FAR = 6.0  # standard deviations: noise has one such sample in 5·10⁸
_UNEXPLAINED = 2.5  # times the noise, a residual that may hide a clamp
_CLAMP_SAMPLES = 4000  # spread over the log, as a clamp lasts
_CLAMPED = 0.5  # of the sum of squares that a clamp leaves
_TIED = 0.99  # correlation of lag and delay that lets the smallest flaw of the model shift one into the other
_TRADED, _UNSURE = 0.9, 0.15  # correlation of lag and delay; share of the lag that its standard error is
_SAME = 10.0  # times the variance, a sum of squares that is no worse: of one parameter √10 standard errors
_UNEXPLAINED_SHARE = 0.15  # of what moved, a residual at which no servo of this kind explains the log
_TRAIN_FRACTION = 0.7  # of a joint's path is fitted, the rest checks
_MIN_SAG_SIGMA = 3.0  # standard errors, of a sag that is there: noise looks so once in 700 logs
_REGULAR = 1.3  # times the floor: a residual that is more than noise
_NOISE_CORRELATION = 0.15  # of neighbouring residuals, that noise has not: 3/√N of 400 samples
# of the sum of squares, and of the RMS not fitted, that second order leaves
_BETTER, _BETTER_ELSEWHERE = 0.8, 0.95
_QUICKEST = 15.0  # times as fast as the motion changes, a bandwidth that it can tell
_LIKELIER = 8.0  # logarithm of how much likelier second order is: by its one parameter more, chance is 6·10⁻⁵
# of the encoder's step, a residual that is mostly rounding: 1/√12 of a position, √2 of that of two
_COARSE = 0.45


@dataclass(frozen=True, eq=False)
class JointTrace:
    """What a fit says of a joint beside what it did, at its samples: shape (N,) each.

    Attributes
    ----------
    time
        s.
    target, position
        Commanded and measured, rad or m.
    fitted
        By the fit of all samples.
    foreseen
        By a fit of the first 70 % of the path, on the rest; NaN before.
    """

    time: Array
    target: Array
    position: Array
    fitted: Array
    foreseen: Array


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
        Time constant τ (2ζ/ω of second order) and delay D from a command to its effect, s.
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
    late
        Lag and delay together, s: known of ambiguous joints, too.
    order
        1, or 2 where the data ask for it.
    bandwidth, damping_ratio
        ω, rad/s, and ζ of second order; NaN of first.
    bandwidth_interval, damping_ratio_interval
        95 %.
    friction
        By how much the joint stays behind to the side that it comes from, rad or m: half of a play, or friction; 0 if
        none is sure.
    unit
        Of its positions, ``"rad"`` or ``"m"``.
    trace
        For plots; None of refused joints.
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
    late: float = math.nan
    order: int = 1
    bandwidth: float = math.nan
    bandwidth_interval: Interval = (math.nan, math.nan)
    damping_ratio: float = math.nan
    damping_ratio_interval: Interval = (math.nan, math.nan)
    friction: float = 0.0
    unit: str = "rad"
    trace: JointTrace | None = field(default=None, repr=False, compare=False)


class _RefusedError(Exception):
    """Why a log does not tell a joint's servo, and what it tells all the same."""

    def __init__(self, reason: str, **known: float) -> None:
        super().__init__(reason)
        self.known = known


def identify_joint(
    name: str, unit: str, segments: list[joint_fit.Segment], period: float
) -> JointIdentification:
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
    positions = joint_fit.positions_of(segments)
    targets = np.concatenate([each.target.values for each in segments])
    resolution = joint_fit.resolution_of(positions)
    noise = max(joint_fit.noise_of(positions, 0.0), resolution)
    bare = JointIdentification(name, resolution=resolution, unit=unit)
    asked, moved = float(np.ptp(targets)), float(np.ptp(positions))
    try:
        if asked < _IDLE:
            raise _RefusedError("idle: its command never changes")
        if asked < _EXCITED * noise:
            by = f"{asked:.3g} {unit}, encoder and noise by {noise:.3g}"
            raise _RefusedError(f"not excited: its command moves by {by}")
        if moved < _STUCK * asked:
            raise _RefusedError(
                f"stuck: it moves by {moved:.3g} {unit} where {asked:.3g} are commanded (a brake?)"
            )
        return _judged(bare, segments, period)
    except _RefusedError as why:
        return replace(bare, reason=str(why), **why.known)


def _judged(
    bare: JointIdentification, segments: list[joint_fit.Segment], period: float
) -> JointIdentification:
    """Return the fit of a joint, or raise `_RefusedError`."""
    resolution, unit = bare.resolution, bare.unit
    found = joint_fit.fit(segments, period)
    rounding = float(
        np.spacing(np.abs(joint_fit.positions_of(segments)).max())
    )  # least noise of a log without any
    segments, dropped = _without_outliers(segments, found, resolution)
    if dropped:
        found = joint_fit.fit(segments, period, near=found)
    floor = max(joint_fit.noise_of(found.residual, resolution), rounding)
    if found.rms > _UNEXPLAINED * floor:
        _check_clamp(segments, found, unit)
    found, segments, friction = _chosen(segments, found, floor, resolution, period)
    spread = float(np.std(joint_fit.positions_of(segments)))
    # at the end of what is searched, within the little that the last steps of the fit leave
    if found.lag > 0.98 * MOST_LAG or found.delay > 0.998 * MOST_DELAY:
        what = f"lag of {MOST_LAG:g} s" if found.lag > 0.98 * MOST_LAG else f"delay of {MOST_DELAY:g} s"
        raise _RefusedError(f"beyond what is searched: a {what} or more fits best")
    if found.rms > _UNEXPLAINED_SHARE * spread:
        left = f"{found.rms:.3g} {unit} RMS of the {spread:.3g} that it moved"
        raise _RefusedError(f"not explained by a lag and a delay: they leave {left}")
    bent = found.kind.order == 2
    sag, sag_interval = math.nan, (math.nan, math.nan)
    if segments[0].torque is not None:
        sag, sag_interval = found.sag, _interval(found.sag, found.sag_error)
        if found.sag < _MIN_SAG_SIGMA * found.sag_error:  # also where it would pull up
            sag, segments = 0.0, [each._replace(torque=None) for each in segments]
            found = joint_fit.fit(segments, period, near=found if bent else None)
    squares = found.residual @ found.residual
    if _is_coarse(found, bare.resolution):
        found = refined(segments, found, bare.resolution)
        if sag:
            sag, sag_interval = found.sag, _interval(found.sag, found.sag_error)
    no_lag = found.lag <= LEAST_LAG * 1.01
    unsure = abs(found.correlation) > _TRADED and found.lag_error > _UNSURE * found.lag
    if found.lag < period / 2 and not bent:  # answers are steps then, whose slopes tell nothing
        delays = found.delay + period * np.linspace(-2, 1, 13).clip(-found.delay / period)
        longer = joint_fit.squares_at(segments, found.lag + period, delays)
        unsure = longer < (1 + _SAME / len(found.residual)) * squares
    # What the model lacks shifts one into the other, and intervals hold for the model alone.
    tied = not bent and abs(found.correlation) > _TIED and found.rms > _REGULAR * floor
    unsure = unsure or tied or not found.delay_error < period
    if unsure:
        both = found.lag + found.delay
        reason = (
            f"ambiguous: lag and delay trade off (correlation {found.correlation:.4f}), only their sum is sure, "
            f"{1e3 * both:.3g} ms; log a faster motion"
        )
        known = {"correlation": found.correlation, "residual": found.rms, "floor": floor, "late": both}
        raise _RefusedError(reason, **known)
    notes = []
    if dropped:
        notes.append(f"{dropped} samples far off were left out")
    if friction:
        notes.append(
            f"comes to rest {friction:.2g} {unit} behind on either side: play, a dead band or friction (half its width)"
        )
    residual, trace = _checked(segments, found, period)
    noise = math.sqrt(max(min(found.rms, floor) ** 2 - (bare.resolution * joint_fit.QUANTUM) ** 2, 0.0))
    if found.rms > _REGULAR * floor:
        notes.append(
            f"{found.rms / floor:.2g} times as much is left as by noise and encoder: "
            f"{'' if bent else 'a servo of higher order, '}{'' if friction else 'friction, '}other joints that pull"
        )
    values, errors = found.values, [found.error(k) for k in range(len(found.values))]
    return replace(
        bare,
        status="fitted",
        lag=0.0 if no_lag else found.lag,
        lag_interval=_interval(found.lag, found.lag_error, least=0.0),
        delay=found.delay,
        delay_interval=_interval(found.delay, found.delay_error, least=0.0),
        gain=found.gain,
        gain_interval=_interval(found.gain, found.gain_error),
        offset=found.offset,
        sag=sag,
        sag_interval=sag_interval,
        noise=noise,
        correlation=found.correlation,
        residual=residual,
        floor=floor,
        notes=tuple(notes),
        late=found.lag + found.delay,
        order=found.kind.order,
        bandwidth=float(values[0]) if bent else math.nan,
        bandwidth_interval=_interval(float(values[0]), errors[0]) if bent else (math.nan, math.nan),
        damping_ratio=float(values[1]) if bent else math.nan,
        damping_ratio_interval=_interval(float(values[1]), errors[1]) if bent else (math.nan, math.nan),
        friction=friction,
        trace=trace,
    )


def _is_coarse(found: joint_fit.Fit, resolution: float) -> bool:
    """Whether what a fit leaves is mostly rounding."""
    return 0 < found.rms < _COARSE * resolution


def _chosen(
    segments: list[joint_fit.Segment], found: joint_fit.Fit, floor: float, resolution: float, period: float
) -> tuple[joint_fit.Fit, list[joint_fit.Segment], float]:
    """Return a fit with play and of second order where the data ask for it, the segments without play, and that."""
    first, played, friction = _with_play(segments, found, resolution)
    residual, is_coarse = first.residual, _is_coarse(first, resolution)
    along = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300)
    if not is_coarse and first.rms < _REGULAR * floor and along < _NOISE_CORRELATION:
        return first, played, friction
    second = joint_fit.second_order_fit(played if is_coarse else segments, found)
    if second.values[0] > _QUICKEST * _rapidity(segments, second):
        return first, played, friction
    if is_coarse:
        before, after = (refined(played, each, resolution).likelihood for each in (first, second))
        return second if after > before + _LIKELIER else first, played, friction
    other = _with_play(segments, second, resolution)
    if other[0].residual @ other[0].residual > _BETTER * (residual @ residual):
        return first, played, friction
    elsewhere = _checked(played, first, period)[0], _checked(other[1], other[0], period)[0]
    return (first, played, friction) if elsewhere[1] > _BETTER_ELSEWHERE * elsewhere[0] else other


def _with_play(
    segments: list[joint_fit.Segment], found: joint_fit.Fit, resolution: float
) -> tuple[joint_fit.Fit, list[joint_fit.Segment], float]:
    """Return a fit with play if there is some, the segments without it, and its half width."""
    half_width = half_play(segments, found, resolution)
    return fit_with_play(segments, found, half_width) if half_width else (found, segments, 0.0)


def _rapidity(segments: list[joint_fit.Segment], found: joint_fit.Fit) -> float:
    """Return how fast the motion changes, rad/s: RMS acceleration over RMS speed."""
    times, outputs = [each.times for each in segments], joint_fit.by_segment(segments, found.output)
    speeds = list(map(np.gradient, outputs, times))
    rates = list(map(np.gradient, speeds, times))
    squares = [float(np.mean(np.concatenate(parts) ** 2)) for parts in (rates, speeds)]
    return math.sqrt(squares[0] / max(squares[1], 1e-300))


def _interval(value: float, error: float, least: float = -math.inf) -> Interval:
    return max(value - joint_fit.NORMAL_95 * error, least), value + joint_fit.NORMAL_95 * error


def _without_outliers(
    segments: list[joint_fit.Segment], found: joint_fit.Fit, resolution: float
) -> tuple[list[joint_fit.Segment], int]:
    """Return the segments without single samples far off, and how many these are; runs of them are no outliers."""
    sizes = np.abs(found.residual)
    usual = max(float(np.median(sizes)) / 0.6745, resolution * joint_fit.QUANTUM)
    far = sizes > _FAR * usual + resolution / 2
    beside = np.convolve(far, np.ones(5), mode="same") > 2  # three of five neighbours: no single samples
    far &= ~beside
    if not far.any():
        return segments, 0
    parts = zip(segments, joint_fit.by_segment(segments, ~far), strict=True)
    return [each.chosen(part) for each, part in parts], int(far.sum())


def _check_clamp(segments: list[joint_fit.Segment], found: joint_fit.Fit, unit: str) -> None:
    """Raise `_RefusedError` if limits of the targets explain at least half of what is left."""
    positions = joint_fit.positions_of(segments)
    targets = np.concatenate([each.target.values for each in segments])
    some = joint_fit.thinned(segments, _CLAMP_SAMPLES)
    first = best = joint_fit.solved(some, found.kind, found.values).squares
    ends = [float(targets.min()), float(targets.max())]
    for _ in range(2):
        for side, extreme in enumerate((float(positions.min()), float(positions.max()))):
            span = float(np.ptp(targets))
            for trial in extreme + span * np.linspace(-0.06, 0.06, 13):
                limits = [trial, ends[1]] if side == 0 else [ends[0], trial]
                if limits[0] >= limits[1]:
                    continue
                clipped = [
                    each._replace(target=each.target._replace(values=np.clip(each.target.values, *limits)))
                    for each in some
                ]
                cost = joint_fit.solved(clipped, found.kind, found.values).squares
                if cost < 0.98 * best:
                    best, ends = cost, limits
    if best <= _CLAMPED * first:
        share = 100 * float(((targets < ends[0]) | (targets > ends[1])).mean())
        raise _RefusedError(
            f"clamped: targets beyond {ends[0]:.4g} … {ends[1]:.4g} {unit} have no effect "
            f"({share:.1f} % of the samples); log a motion that stays inside"
        )


def _checked(
    segments: list[joint_fit.Segment], found: joint_fit.Fit, period: float
) -> tuple[float, JointTrace]:
    """Return the RMS that a fit of the first 70 % of the joint's path leaves on the rest, NaN if nothing is left."""
    paths = [np.concatenate([[0.0], np.cumsum(np.abs(np.diff(each.target.values)))]) for each in segments]
    wanted, before = _TRAIN_FRACTION * sum(float(each[-1]) for each in paths), 0.0
    begun, rest = list[joint_fit.Segment](), list[NDArray[np.bool_]]()
    for each, path in zip(segments, paths, strict=True):
        until = each.target.begins[min(np.searchsorted(path, wanted - before), len(path) - 1)]
        early = each.times <= until
        if before + path[-1] <= wanted:
            early[:] = True
        elif before >= wanted:
            early[:] = False
        before += float(path[-1])
        begun += [each.chosen(early)] if early.sum() > 20 else []
        rest.append(~early & ((~early).sum() > 20))
    foreseen = [np.full(len(each.times), np.nan) for each in segments]
    left = list[Array]()
    if begun and any(late.any() for late in rest):
        from_begin = joint_fit.fit(begun, period, near=found)
        for each, late, shown in zip(segments, rest, foreseen, strict=True):
            if late.any():
                away = (each.positions - joint_fit.predicted(from_begin, each))[late]
                shown[late] = each.positions[late] - away + away.mean()
                left.append(away - away.mean())
    samples = zip(*((each.times, _held_at(each), each.positions) for each in segments), strict=True)
    times, targets, positions = map(np.concatenate, samples)
    trace = JointTrace(times, targets, positions, found.output, np.concatenate(foreseen))
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2))) if left else math.nan, trace


def _held_at(segment: joint_fit.Segment) -> Array:
    """Return the target at the samples."""
    begins, values, slopes = segment.target
    last = np.searchsorted(begins, segment.times, side="right") - 1
    return values[last] + slopes[last] * (segment.times - begins[last])
