"""Whether a controller's loops are expected to be stable, before and while it moves a robot."""

from __future__ import annotations

from dataclasses import replace

from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.check import loop_checks
from dqcontrol.experiments.spec import AnyLaw
from dqcontrol.laws import PreparedLaw
from dqcontrol.measures.stability import MOST_STATES, loop_gains, spectral_radius, with_integral, with_lag
from dqcontrol.ros2.loading import Loaded

OVERRIDE = "allow_unstable"
_STABLE = 1 + 1e-9  # spectral radius: a gain of 0 has 1


def check_stable(loaded: Loaded, law: AnyLaw, prepared: PreparedLaw, *, advise: bool) -> None:
    """Check a law's loops, as `dqcontrol check` does, on the spec's plant.

    Parameters
    ----------
    loaded
        The spec.
    law, prepared
        What is to be judged, and the same ready to run.
    advise
        Also find the gain to choose, which takes up to half a second.

    Raises
    ------
    ValueRangeError
        If a loop is expected to be unstable.
    """
    gains, model = loop_gains(law, prepared), loaded.linear_model
    if gains is None or model is None or len(model.transition) > MOST_STATES:
        return
    for gain in gains:
        lagged = with_lag(model, gain.lag, loaded.period)
        closed = with_integral(lagged, gain.integral_share * abs(gain.value), loaded.period)
        radius = spectral_radius(closed.poles(gain.value))
        if radius <= _STABLE:
            continue
        why = (
            f"{gain.loop} unstable: k T = {abs(gain.value) * loaded.period:.3g}, spectral radius {radius:.3g}"
        )
        if advise:
            case = replace(loaded.case, gains=gains)
            (checked,) = loop_checks(replace(loaded.setting, cases=(case,)))
            why = checked.remark or why
        raise ValueRangeError(f"law: {why}; the parameter {OVERRIDE} lets it through")
