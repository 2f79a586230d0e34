"""Whether a controller's loops are expected to be stable, before and while it moves a robot."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.check import loop_checks
from dqcontrol.experiments.spec import AnyLaw
from dqcontrol.laws import PreparedLaw
from dqcontrol.limits import Supervisor
from dqcontrol.measures.stability import (
    MOST_STATES,
    loop_gains,
    spectral_radius,
    with_integral,
    with_lag,
    with_mean,
)
from dqcontrol.plants.plant import command_mode
from dqcontrol.ros2.loading import Loaded

OVERRIDE = "allow_unstable"
_STABLE = 1 + 1e-9  # spectral radius: a gain of 0 has 1


def check_stable(
    loaded: Loaded, law: AnyLaw, prepared: PreparedLaw, supervisor: Supervisor, *, advise: bool
) -> None:
    """Check a law's loops, as `dqcontrol check` does, on the spec's plant.

    Parameters
    ----------
    loaded
        The spec.
    law, prepared
        What is to be judged, and the same ready to run.
    supervisor
        Whose smoothing is part of the loops.
    advise
        Also find the gain to choose, which takes up to half a second.

    Raises
    ------
    ValueRangeError
        If a loop is expected to be unstable.
    """
    gains, model = loop_gains(law, prepared), loaded.linear_model
    if gains is None or model is None:
        return
    mode, period = command_mode(loaded.case.plant), loaded.period
    window = supervisor.prepare(loaded.robot, period, mode).window
    model = with_mean(model, window, period, from_measured=mode == "measured")
    if len(model.transition) > MOST_STATES:
        return
    for gain in gains:
        lagged = with_lag(model, gain.lag, loaded.period)
        closed = with_integral(lagged, gain.integral_share * abs(gain.value), loaded.period)
        radius = spectral_radius(closed.poles(gain.value))
        if radius <= _STABLE:
            continue
        why = f"{gain.loop} unstable: k = {abs(gain.value):.3g} 1/s, spectral radius {radius:.3g}"
        if advise:
            case = replace(loaded.case, gains=gains)
            spec = msgspec.structs.replace(loaded.setting.spec, supervisor=supervisor)
            (checked,) = loop_checks(replace(loaded.setting, spec=spec, cases=(case,)))
            why = checked.remark or why
        raise ValueRangeError(f"law: {why}; the parameter {OVERRIDE} lets it through")
