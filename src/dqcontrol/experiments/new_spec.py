"""A first experiment for a robot: where it starts, how large the motion is and how high the gain, chosen for it."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import LimitWarning, ReachError, ValueRangeError
from dqcontrol.experiments.check import check
from dqcontrol.experiments.gain_advice import rounded_down
from dqcontrol.files.units import as_quantity, number_in, unsaid_unit
from dqcontrol.robots import Robot, describe, load_robot, most_dexterous

_SIZES = (0.1, 0.05, 0.02, 0.01)  # of the reach, tried in turn
_ABOVE = 0.2  # of the reach; twice the largest motion, as arms stand on tables
_MOST_GAIN = 10.0  # 1/s
_DURATION = 8  # s
_PLANTS = {
    "servo": "{kind: servo, time_constant: 50 ms}",
    "integrator": "{kind: integrator}",
    "mujoco": "{kind: mujoco}",
}
_GAINS_NOTE = "1/s; dqcontrol check says how near it is to instability"


def new_spec(
    name: str,
    robot: str,
    motion: str,
    period: str,
    law: str,
    plant: str,
    *,
    base_link: str | None = None,
    tip_link: str | None = None,
) -> tuple[str, str]:
    """Return the YAML text of a first experiment, and what there is to say about it.

    Parameters
    ----------
    name
        Of the experiment.
    robot
        Name or file.
    motion
        ``"circle"``, ``"square"``, ``"spiral"`` or ``"set-point"``.
    period
        Seconds, or with a unit as ``"8 ms"``.
    law
        ``"proportional"``, ``"proportional-feedforward"`` or ``"both"``.
    plant
        ``"servo"``, ``"integrator"`` or ``"mujoco"``.
    base_link, tip_link
        Ends of the chain in a URDF file.

    Raises
    ------
    Error
        If the robot cannot be loaded, the period is none, or no motion is within reach.
    """
    arm, seconds = load_robot(robot, base_link, tip_link), _seconds(period)
    ends = {key: link for key, link in (("base_link", base_link), ("tip_link", tip_link)) if link is not None}
    start = _rounded(most_dexterous(arm, _ABOVE * (describe(arm).reach or 1.0)), arm)
    kinds = ["proportional", "proportional-feedforward"] if law == "both" else [law]
    spec: dict[str, Any] = {
        "name": name,
        "robot": {"source": robot, **ends},
        "start": start.tolist(),
        "period": seconds,
        "plant": {"kind": plant} | ({"time_constant": 0.05} if plant == "servo" else {}),
    }
    size, gain = _fitting(spec, arm, motion, kinds[-1])
    laws = [f"  {_LABELS[kind]}: {{kind: {kind}, gain: {gain:g}}}" for kind in kinds]
    lines = [
        f"# A {motion} by {arm.name}. Change what you like; dqcontrol list laws, references or plants: what there is.",
        f"name: {name}",
        f"robot: {_flow({'source': robot, **ends}) if ends else robot}",
        f"start: [{', '.join(_angle(value, kind) for value, kind in zip(start, arm.joint_types, strict=True))}]",
        f"period: {seconds * 1e3:g} ms",
        f"reference: {_flow(_reference(motion, size))}",
        *(
            [f"laws:   # gains in {_GAINS_NOTE}", *laws]
            if len(kinds) > 1
            else [f"law: {{kind: {kinds[0]}, gain: {gain:g}}}   # {_GAINS_NOTE}"]
        ),
        f"plant: {_PLANTS[plant]}",
    ]
    remark = f" (gain {gain:g} 1/s" + (f", size {size * 1e3:g} mm)" if motion != "set-point" else ")")
    return "\n".join(lines) + "\n", remark


_LABELS = {"proportional": "K", "proportional-feedforward": "K+FF"}


def _fitting(spec: dict[str, Any], arm: Robot, motion: str, kind: str) -> tuple[float, float]:
    """Return the largest size within reach and the gain that `check` recommends for it, both rounded."""
    reach = describe(arm).reach or 1.0
    why: Exception | None = None
    for share in _SIZES:
        size = float(f"{share * reach:.1g}")
        trial = {**spec, "reference": _reference(motion, size), "law": {"kind": kind, "gain": 1.0}}
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", LimitWarning)
                (row,) = check(trial)
        except (ReachError, LimitWarning) as error:
            why = error
            continue
        if not row.loops or not any(loop.limits.recommended > 0 for loop in row.loops):
            return size, 1.0
        most = min(loop.limits.recommended for loop in row.loops) / row.period
        return size, _MOST_GAIN if most >= _MOST_GAIN else rounded_down(most, 1)
    raise ReachError(f"motion: no {motion} from 1 to 10 % of the reach fits around {arm.name}'s start: {why}")


def _reference(motion: str, size: float) -> dict[str, Any]:
    if motion == "set-point":  # 2 % of the reach away, so that there is something to do
        return {"kind": motion, "duration": _DURATION, "offset": {"translation": [0, 0, -size]}}
    lengths = {
        "circle": {"radius": size},
        "square": {"side": size},
        "spiral": {"radius": size, "length": size},
    }
    return {"kind": motion, **lengths[motion], "duration": _DURATION}


def _flow(data: dict[str, Any]) -> str:
    def said(key: str, value: Any) -> str:
        if key in ("radius", "side", "length"):
            return f"{value * 1e3:g} mm"
        return _flow(value) if isinstance(value, dict) else f"{value} s" if key == "duration" else str(value)

    return "{" + ", ".join(f"{key}: {said(key, value)}" for key, value in data.items()) + "}"


def _seconds(period: str) -> float:
    value, unit = as_quantity(period) or (0.0, "")
    seconds = 1.0 / value if unit == "Hz" and value > 0 else number_in(period, "s")
    if seconds is not None and not unit and (asked := unsaid_unit("period", seconds, "s")):
        raise ValueRangeError(f"period: {asked}")
    if seconds is None or not 0 < seconds <= 10:
        raise ValueRangeError(f"period: expected a time, as 8 ms, or a rate, as 125 Hz, got '{period}'")
    return seconds


def _rounded(q: NDArray[np.float64], arm: Robot) -> NDArray[np.float64]:
    """Return a configuration in whole degrees and millimetres."""
    turns = np.array([kind == "revolute" for kind in arm.joint_types])
    return np.where(turns, np.radians(np.round(np.degrees(q))), np.round(q, 3))


def _angle(value: float, kind: str) -> str:
    return f"{round(math.degrees(value))} deg" if kind == "revolute" else f"{value:.3f}"
