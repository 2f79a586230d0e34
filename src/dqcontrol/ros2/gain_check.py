"""Whether a controller's loops are expected to be stable, before and while it moves a robot."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from dqcontrol.controller import Controller
from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.check import loop_checks
from dqcontrol.experiments.contact_check import bears_world
from dqcontrol.experiments.spec import AnyLaw
from dqcontrol.measures.stability import (
    MOST_STATES,
    LoopGain,
    loop_gains,
    spectral_radius,
    with_integral,
    with_lag,
    with_mean,
)
from dqcontrol.plants.plant import command_mode
from dqcontrol.ros2.loading import Loaded
from dqcontrol.supervisor import Supervisor

OVERRIDE = "allow_unstable"
_STABLE = 1 + 1e-9  # spectral radius: a gain of 0 has 1


def check_stable(
    loaded: Loaded, law: AnyLaw, prepared: Controller, supervisor: Supervisor, *, moves: bool
) -> str:
    """Check a law's loops, as `dqcontrol check` does, on the spec's plant; return why they cannot be judged, if so.

    Parameters
    ----------
    loaded
        The spec.
    law, prepared
        What is to be judged, and the same ready to run.
    supervisor
        Whose smoothing is part of the loops.
    moves
        Whether it moves a robot: there is no time then to find the gain to choose, up to half a second, nor to
        linearise a law.

    Raises
    ------
    ValueRangeError
        If a loop is expected to be unstable; or the law's gains are unknown and it moves a robot.
    """
    gains, model = loop_gains(law, prepared), loaded.linear_model
    if gains is None:
        if moves:
            why = "its loop gains are unknown, so it may be changed only while the controller is inactive"
            raise ValueRangeError(f"law: {why}; the parameter {OVERRIDE} lets it through")
        return _as_check_says(loaded, law, gains, supervisor)
    if model is None:
        return "" if moves else _as_check_says(loaded, law, gains, supervisor)
    mode, period = command_mode(loaded.case.plant), loaded.period
    window = supervisor.prepare(loaded.robot, period, mode).window
    model = with_mean(model, window, period, from_measured=mode == "measured")
    if len(model.transition) > MOST_STATES:
        return "" if moves else _as_check_says(loaded, law, gains, supervisor)
    for gain in gains:
        lagged = with_lag(model, gain.lag, loaded.period)
        closed = with_integral(lagged, gain.integral_share * abs(gain.value), loaded.period)
        radius = spectral_radius(closed.poles(gain.value))
        if radius <= _STABLE:
            continue
        if not moves:
            _as_check_says(loaded, law, gains, supervisor)
        raise _unstable(f"{gain.loop} unstable: k = {abs(gain.value):.3g} 1/s, spectral radius {radius:.3g}")
    return ""


def check_bears(loaded: Loaded, law: AnyLaw) -> None:
    """Raise a `ValueRangeError` if the springy bodies of the spec's world make a law's contact unstable."""
    model = loaded.linear_model
    case = replace(loaded.case, variant=replace(loaded.case.variant, law=law), prepared=None)
    if model is not None and not bears_world(loaded.setting.spec, case, model):
        raise ValueRangeError(
            f"contact: unstable against the stiffest body of the world; the parameter {OVERRIDE} lets it through"
        )


def _as_check_says(
    loaded: Loaded, law: AnyLaw, gains: tuple[LoopGain, ...] | None, supervisor: Supervisor
) -> str:
    """Return why `dqcontrol check` cannot judge a law; raise a `ValueRangeError` if it expects it to be unstable."""
    case = replace(loaded.case, variant=replace(loaded.case.variant, law=law), gains=gains, prepared=None)
    spec = msgspec.structs.replace(loaded.setting.spec, supervisor=supervisor)
    (checked,) = loop_checks(replace(loaded.setting, spec=spec, cases=(case,)))
    if checked.verdict == "unstable":
        raise _unstable(checked.remark)
    return checked.remark if checked.unknown else ""


def _unstable(why: str) -> ValueRangeError:
    return ValueRangeError(f"law: {why}; the parameter {OVERRIDE} lets it through")
