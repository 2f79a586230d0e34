"""ROS parameters of a loaded spec's numbers, and the meaning of changing one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec
from msgspec import Struct

from dqcontrol.contact import Admittance
from dqcontrol.controller import Controller
from dqcontrol.errors import Error, ValueRangeError
from dqcontrol.experiments.check import loop_checks
from dqcontrol.experiments.contact_check import bears_world
from dqcontrol.experiments.spec import AnyLaw
from dqcontrol.measures import stability
from dqcontrol.named_fields import check_fields
from dqcontrol.plants.plant import command_mode
from dqcontrol.ros2 import haptic_topics
from dqcontrol.ros2.loading import Loaded
from dqcontrol.ros2.localisation import numbers_of_odometry
from dqcontrol.ros2.parameters import Number
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
    gains, model = stability.loop_gains(law, prepared), loaded.linear_model
    if gains is None:
        if moves:
            raise _refused(
                "its loop gains are unknown, so it may be changed only while the controller is inactive"
            )
        return _as_check_says(loaded, law, gains, supervisor)
    mode, period = command_mode(loaded.case.plant), loaded.period
    if model is not None:
        window = supervisor.prepare(loaded.robot, period, mode).window
        model = stability.with_mean(model, window, period, from_measured=mode == "measured")
    if model is None or len(model.transition) > stability.MOST_STATES:
        return "" if moves else _as_check_says(loaded, law, gains, supervisor)
    for gain in gains:
        lagged = stability.with_lag(model, gain.lag, period)
        closed = stability.with_integral(lagged, gain.integral_share * abs(gain.value), period)
        radius = stability.spectral_radius(closed.poles(gain.value))
        if radius <= _STABLE:
            continue
        if not moves:
            _as_check_says(loaded, law, gains, supervisor)
        raise _refused(f"{gain.loop} unstable: k = {abs(gain.value):.3g} 1/s, spectral radius {radius:.3g}")
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
    loaded: Loaded, law: AnyLaw, gains: tuple[stability.LoopGain, ...] | None, supervisor: Supervisor
) -> str:
    """Return why `dqcontrol check` cannot judge a law; raise a `ValueRangeError` if it expects it to be unstable."""
    case = replace(loaded.case, variant=replace(loaded.case.variant, law=law), gains=gains, prepared=None)
    spec = msgspec.structs.replace(loaded.setting.spec, supervisor=supervisor)
    (checked,) = loop_checks(replace(loaded.setting, spec=spec, cases=(case,)))
    if checked.verdict == "unstable":
        raise _refused(checked.remark)
    return checked.remark if checked.unknown else ""


def _refused(why: str) -> ValueRangeError:
    return ValueRangeError(f"law: {why}; the parameter {OVERRIDE} lets it through")


T = TypeVar("T", bound=Struct)

_LAW, _CONTACT, _SUPERVISOR = "law.", "contact.", "supervisor."
_AXES = "xyz"
_FARTHEST = 100.0  # m
_OWN = (
    Number(
        "enable_timeout",
        0.0,
        0.0,
        1.0,
        "without ~/enable being true before the robot stops, s; 0: not needed",
    ),
    Number("start_tolerance", 0.1, 0.0, 3.2, "how far joints may be from the spec's start, rad or m"),
    Number("linear_speed", 0.1, 0.001, 2.0, "of the desired pose on the way to a pose or by a twist, m/s"),
    Number("angular_speed", 0.5, 0.001, 6.0, "of the same, rad/s"),
    Number("acceleration", 1.0, 0.01, 20.0, "of the same, m/s²; that of turns in proportion to the speeds"),
    Number("twist_timeout", 0.1, 0.01, 1.0, "after which a twist no longer counts, s"),
    Number(
        "pose_timeout",
        0.0,
        0.0,
        10.0,
        "after which a pose no longer counts and the hand stays where it is, s; 0: it always counts",
    ),
)


def numbers_of(loaded: Loaded, source: str) -> list[Number]:
    """Return all numbers that may be changed: our own, the law's, of its contact, and the supervisor's.

    Where one number may stand and the spec has none, or one for each joint or axis, its value is None.
    """
    return [
        *_OWN,
        *(haptic_topics.NUMBERS if source == "haptics" else ()),
        *(numbers_of_odometry(loaded.period, loaded.stale_after) if loaded.parts.base else ()),
        *_fields(_LAW, loaded.law, "of the law; while active only if it is constant over time"),
        *_compliances(loaded.law.contact),
        *_fields(_SUPERVISOR, loaded.supervisor, "of the supervisor; only while inactive"),
        *_fields(f"{_SUPERVISOR}payload.", loaded.payload, "of what it carries; only while inactive"),
    ]


def with_numbers(struct: T, prefix: str, numbers: Mapping[str, float]) -> T:
    """Return a structure with those numbers whose names have the prefix.

    Raises
    ------
    ValueRangeError
        If the structure does not allow one.
    """
    own = {name.removeprefix(prefix): value for name, value in numbers.items() if name.startswith(prefix)}
    try:
        data = msgspec.to_builtins(struct)
        for name, value in own.items():
            data = _replaced(data, name.split("."), value)
        check_fields(type(struct), {key: data[key] for key in (name.partition(".")[0] for name in own)})
        return msgspec.convert(data, type(struct)) if own else struct
    except msgspec.ValidationError as error:
        raise ValueRangeError(f"{prefix}{next(iter(own))}: {error}") from None


def retune(
    loaded: Loaded,
    numbers: Mapping[str, float],
    *,
    active: bool,
    allow_unstable: bool,
    leader: Mapping[str, float] | None = None,
) -> tuple[bool, bool, str]:
    """Change law, supervisor and speeds; return whether law and supervisor did, and why that law cannot be judged.

    Parameters
    ----------
    loaded
        The spec; changed.
    numbers
        By name.
    active
        Whether the controller moves the robot.
    allow_unstable
        Whether a law may be one whose loops are expected to be unstable.
    leader
        Numbers of `haptic_topics` as they will be, where a leader feels what the arm does.

    Raises
    ------
    Error
        If a number is not allowed, or not now; nothing is changed then.
    """
    law = with_numbers(loaded.law, _LAW, numbers)
    contact = law.contact and with_numbers(law.contact, _CONTACT, numbers)
    if contact is not law.contact:
        law = msgspec.structs.replace(law, contact=contact)
    supervisor = with_numbers(loaded.supervisor, _SUPERVISOR, numbers)
    if active and supervisor is not loaded.supervisor:
        raise Error("the supervisor may be changed only while the controller is inactive")
    if active and law is not loaded.law and law.horizon(loaded.case.scene.reference) > 0:
        raise Error("this law depends on time; it may be changed only while the controller is inactive")
    prepared = loaded.prepared_law("spec", law)
    unjudged = ""
    if not allow_unstable and (law is not loaded.law or not active):
        unjudged = check_stable(loaded, law, prepared, supervisor, moves=active)
    if leader is not None and not allow_unstable:
        haptic_topics.check_leader(loaded, law, leader)
    elif contact != loaded.law.contact and not allow_unstable:
        check_bears(loaded, law)
    supervisor.prepare(loaded.robot, loaded.period)
    changes = law is not loaded.law, supervisor is not loaded.supervisor, unjudged
    loaded.law, loaded.supervisor = law, supervisor
    loaded.speeds.linear = numbers.get("linear_speed", loaded.speeds.linear)
    loaded.speeds.angular = numbers.get("angular_speed", loaded.speeds.angular)
    loaded.speeds.acceleration = numbers.get("acceleration", loaded.speeds.acceleration)
    return changes


def _compliances(contact: Admittance | None) -> Iterator[Number]:
    for part in ("translation", "rotation", "force") if contact is not None else ():
        parameters = getattr(contact, part)
        if isinstance(parameters, Struct):
            yield from _fields(f"{_CONTACT}{part}.", parameters, "of the compliant frame")


def _fields(prefix: str, struct: Struct, description: str) -> list[Number]:
    hints, found = get_type_hints(type(struct)), []
    for field in struct.__struct_fields__:
        value, hint = getattr(struct, field), hints[field]
        if hint == tuple[float, float, float]:
            found += [
                Number(f"{prefix}{field}.{axis}", float(x), -_FARTHEST, _FARTHEST, f"{field} {description}")
                for axis, x in zip(_AXES, value, strict=True)
            ]
        elif hint in (float, int) or float in get_args(hint):
            default = float(value) if type(value) in (float, int) else None
            found.append(Number(prefix + field, default, 0.0, 1e6, f"{field} {description}"))
    return found


def _replaced(data: Any, path: Sequence[str], value: float) -> Any:
    """Return mappings and vectors with the number at a path of keys and axes replaced."""
    if not path:
        return value
    if isinstance(data, Mapping):
        return {**data, path[0]: _replaced(data.get(path[0]), path[1:], value)}
    i = _AXES.index(path[0])
    return [*data[:i], value, *data[i + 1 :]]
