"""Units of the parameters of specs, as the descriptions of their keys say."""

from __future__ import annotations

from functools import cache

from dqcontrol.experiments.spec import Spec
from dqcontrol.experiments.spec.key_types import kinds_below, kinds_of, unit_in


@cache
def parameter_unit(key: str) -> str:
    """Return the unit of a parameter; empty where it has none, or laws and plants disagree on it.

    Parameters
    ----------
    key
        Path in a spec, as ``"plant.time_constant"`` or ``"laws.*.gain"``, or the name of a law's parameter.

    Examples
    --------
    >>> parameter_unit("laws.*.gain"), parameter_unit("plant.encoder_noise"), parameter_unit("seed")
    ('1/s', 'rad or m', '')
    """
    path = key if key.partition(".")[0] in Spec.__struct_fields__ else f"law.{key}"
    return unit_in(kinds_below(list(kinds_of(Spec)), path))


def with_unit(key: str) -> str:
    """Return a parameter's name with its unit, as ``"plant.time_constant [s]"``."""
    unit = parameter_unit(key)
    return f"{key} [{unit}]" if unit else key
