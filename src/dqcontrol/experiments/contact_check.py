"""Stability of a spec's contact loops, and the stiffness of its world beside what they bear."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import replace

from dqcontrol import algebra
from dqcontrol.contact import Admittance, ContactLimits, ForceReference, bears, contact_limits
from dqcontrol.contact.admittance import NEEDS_CONTACT
from dqcontrol.errors import ValueRangeError
from dqcontrol.plants.plant import RunningPlant, lagging_mode, running_plant
from dqcontrol.plants.sensors import Wrist
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.tables.tables import Column, Table

if TYPE_CHECKING:
    from dqcontrol.controller import Controller
    from dqcontrol.experiments.prepared_experiment import Combination
    from dqcontrol.experiments.spec import Spec
    from dqcontrol.plants.linear_model import LinearModel

# radii from the middle
_RIM = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
_LATE = 1.2  # of the approach speed, which is predicted within a fifth
_NOISES = 6.0  # standard deviations that one reading of a sensor may be off, in 3 axes
_MOVES = 1e-6  # of the eight coefficients of a pose: 2 µm
_UNKNOWN_STIFFNESS = 1e4  # N/m, for a world that says none: a table top of wood under a finger


def check_contact(spec: Spec, case: Combination) -> None:
    """Raise an error if a force is wanted without a sensor, or against something that the loop does not bear.

    Raises
    ------
    ValueRangeError
        If so.
    """
    contact = case.variant.law.contact
    if contact is None:
        if case.scene.reference.guards.moves:
            raise ValueRangeError(NEEDS_CONTACT)
        return
    robot, start = case.scene.robot, case.scene.start
    # A robot is started by nothing but a run, and no driver of one measures a wrench.
    plant = None
    if not case.plant.is_robot:
        plant = running_plant(case.plant.start(robot, start, spec.period, 1, spec.seed))
    if plant is None or not plant.wrench.size:
        kind = type(case.plant).__struct_config__.tag
        raise ValueRangeError(
            f"contact: plant '{kind}' measures no wrench, so no force can be controlled; "
            "give a plant with a force sensor, as servo with 'wrist'"
        )
    _check_tool(contact, case, plant, spec.period)
    tare, samples = contact.sensor.tare, case.scene.samples
    away = np.abs(samples[:, POSE] - samples[0, POSE]).max(axis=1) > _MOVES
    if tare and (first := samples[away, TIME]).size and first[0] < tare:
        raise ValueRangeError(
            f"contact.sensor.tare: the reference moves from {first[0]:.3g} s on, and is to rest for the {tare:g} s in "
            "which the sensor's bias is measured; let it begin with a set-point of that duration"
        )
    stiffest = stiffest_body(spec)
    if contact.allow_unstable or stiffest is None:
        return
    limits = limits_of(spec, case)
    if limits.axis in ("x", "y", "z") and stiffest[1] >= limits.stiffness:
        cure = f"damping must be above {limits.least_damping:.3g} N·s/m for it"
        if np.isinf(limits.least_damping):
            cure = "no damping makes it stable"
        raise ValueRangeError(
            f"contact: world.{stiffest[0]} has {stiffest[1]:.4g} N/m, but along {limits.axis} this loop is unstable "
            f"from {limits.stiffness:.3g} N/m on; {cure} (allow_unstable: true runs it all the same)"
        )
    _check_approach(spec, case, contact, limits)


def _check_tool(contact: Admittance, case: Combination, plant: RunningPlant, period: float) -> None:
    """Raise an error if a tool's data do not explain what the sensor shows at the start, where nothing touches."""
    if contact.sensor.tool is None or contact.sensor.tare:
        return
    plant.step(np.zeros(case.scene.robot.input_size))
    contact_wrench = contact.start(period).contact_wrench(
        case.scene.robot.fkm(case.scene.start), plant.wrench
    )
    noise = getattr(getattr(case.plant, "wrist", None), "force_noise", 0.0)
    left, allowed = float(np.linalg.norm(contact_wrench[3:])), 2 * contact.lost.below + _NOISES * noise
    if left > allowed:
        raise ValueRangeError(
            f"contact.sensor.tool: leaves {left:.3g} N on the sensor at the start, where nothing touches (allowed: "
            f"{allowed:.3g} N): it is that of another tool; dqcontrol identify tool finds this one's"
        )


def _check_approach(spec: Spec, case: Combination, contact: Admittance, limits: ContactLimits) -> None:
    """Raise an error if the reference runs into a springy box faster than the loop bears, or comes near none."""
    boxes = {
        name: body for name, body in (spec.world or {}).items() if body.stiffness is not None and body.box
    }
    if limits.approach_speed is None or not boxes:
        return
    poses, times = case.scene.samples[:, POSE], case.scene.samples[:, TIME]
    forces = contact.wanted_forces(times)
    wanted = np.array([float(max(forces.get(axis, [0.0]), key=abs)) for axis in "xyz"])
    places = algebra.translation(poses)
    speeds = contact.turned_to_axes(np.diff(places, axis=0) / spec.period, poses[1:], poses[1:])
    towards = -speeds @ (wanted / np.linalg.norm(wanted))
    nearest, deepest = np.inf, contact.limits.depth or np.inf
    for name, body in boxes.items():
        frame = algebra.matrix_from_pose(body.pose)
        beyond = np.abs((places - frame[:3, 3]) @ frame[:3, :3]) - 0.5 * np.array(body.box)
        away = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        nearest = min(nearest, float(away.min()))
        k = int((away == 0.0).argmax()) - 1  # the way that ends in the first place inside
        if k >= 0 and towards[k] > _LATE * limits.approach_speed:
            raise ValueRangeError(
                f"reference: runs into world.{name} at {1e3 * towards[k]:.3g} mm/s, at t = "
                f"{times[k + 1]:.3g} s, and from {1e3 * limits.approach_speed:.3g} mm/s on the force "
                "peaks beyond three times the wanted one; approach slower (allow_unstable: true runs it all the same)"
            )
    if nearest > deepest:
        raise ValueRangeError(
            f"contact: nothing springy comes nearer than {nearest:.3g} m to the reference, and contact.limits.depth is "
            f"{deepest:g} m: no force would come about"
        )


def limits_of(spec: Spec, case: Combination) -> ContactLimits:
    """Return what the contact loop of a case bears at its start, before the stiffest springy body of its world."""
    touched = stiffness_touched(spec)
    contact, law = _loop_of(spec, case)
    wrist = getattr(case.plant, "wrist", None)
    rim: Any = ()
    if isinstance(wrist, Wrist) and wrist.flat and any(contact.force.components[3:]):
        rim = wrist.radius * _RIM  # which touches the edge of a hole, or a table, while it is tilted
    return contact_limits(contact, law, case.plant, case.scene.start, touched, rim)


def bears_world(spec: Spec, case: Combination, model: LinearModel) -> bool:
    """Return whether the contact loop of a case is stable before the stiffest springy body of its world, if any."""
    stiffest = stiffest_body(spec)
    soft = case.plant.compliance(case.scene.robot, case.scene.start)
    return stiffest is None or bears(*_loop_of(spec, case), model, case.scene.start, stiffest[1], soft)


def _loop_of(spec: Spec, case: Combination) -> tuple[Admittance, Controller]:
    """Return the admittance of a case, with the filter of its wrist, and its law without it, ready to run."""
    prepared = replace(case.variant.law, contact=None).prepare(
        case.scene.robot,
        case.scene.reference,
        spec.period,
        case.limits,
        lagging_mode(case.plant),
        lag=case.lag,
    )
    return sensed(case), prepared


def stiffest_body(spec: Spec) -> tuple[str, float] | None:
    """Return name and stiffness, N/m, of the stiffest springy body of a spec's world; None where none is."""
    bodies = (spec.world or {}).items()
    found = [(name, body.stiffness) for name, body in bodies if body.stiffness is not None]
    return max(found, key=lambda each: each[1], default=None)


def stiffness_touched(spec: Spec) -> float:
    """Return the stiffness of the stiffest springy body of a spec's world, N/m; of a table top where none says one."""
    stiffest = stiffest_body(spec)
    return _UNKNOWN_STIFFNESS if stiffest is None else stiffest[1]


def sensed(case: Combination) -> Admittance:
    """Return the admittance of a case, with the filter of its wrist if that is slower."""
    contact = case.variant.law.contact
    assert contact is not None
    slower = max(contact.sensor.filter, getattr(getattr(case.plant, "wrist", None), "filter", 0.0))
    return replace(contact, sensor=replace(contact.sensor, filter=slower))


def contact_table(spec: Spec, cases: tuple[Combination, ...]) -> Table | None:
    """Return what each knob of the contact loops means; None without contact."""
    rows = [
        [case.names.label, *row]
        for case in cases
        if case.variant.law.contact is not None
        for row in _meanings(case.variant.law.contact, limits_of(spec, case), spec)
    ]
    columns = [Column("case"), Column("knob"), Column("value"), Column("what it means")]
    first = len(cases) == 1  # the label of one case says nothing
    return Table(columns[first:], [row[first:] for row in rows], "contact") if rows else None


def _age(tared: str | None) -> str:
    """Say how old the bias of a tool is."""
    if tared is None:
        return "bias of unknown age"
    days = (datetime.now(UTC).date() - date.fromisoformat(tared)).days
    return "bias measured " + ("today" if days <= 0 else "a day ago" if days == 1 else f"{days} days ago")


def _meanings(contact: Admittance, limits: ContactLimits, spec: Spec) -> Iterator[list[str]]:
    """Yield knob, value and what it means."""
    if tool := contact.sensor.tool:
        again = "" if contact.sensor.tare else "; sensors drift, so give sensor.tare: 0.5 s, in the air"
        yield ["sensor.tool", f"{tool.mass:.3g} kg", _age(tool.tared) + again]
    if tare := contact.sensor.tare:
        yield ["sensor.tare", f"{tare:.3g} s", "bias measured at the start, at rest in the air"]
    i = ("mx", "my", "mz", "x", "y", "z").index(limits.axis)
    mass, damping, stiffness = contact.axis_rows[i]
    along, wall = f" along {limits.axis}", "N·m/rad" if i < 3 else "N/m"
    of_damping, of_mass, of_force = ("N·m·s/rad", "kg·m²", "N·m") if i < 3 else ("N·s/m", "kg", "N")
    touched, loose, damps = stiffness_touched(spec), limits.loose_part, f"{damping:.4g} {of_damping}"
    bears = "whatever stands still" if np.isinf(limits.stiffness) else f"up to {limits.stiffness:.3g} {wall}"
    needs = "is borne with none" if np.isinf(limits.least_damping) else f"needs {limits.least_damping:.3g}"
    yield ["damping" + along, damps, f"bears {bears}; {touched:.4g} {wall} {needs}"]
    if loose.mass:
        words = f"a contact of up to {loose.stiffness:.3g} N/m (worst: {loose.mass:.3g} kg)"
        yield ["damping" + along, damps, f"bears loose parts behind {words}"]
    if mass:
        lag = f"a lag of {1e3 * mass / damping:.3g} ms in the loop" if damping else "no damping"
        yield ["mass" + along, f"{mass:.4g} {of_mass}", lag]
    wanted = contact.force.components[i]
    if wanted is not None and damping:
        size = float(np.abs(wanted.values).max()) if isinstance(wanted, ForceReference) else abs(wanted)
        speed = f"moves the end effector in free space at {1e3 * size / damping:.3g} mm/s"
        yield [f"force.{limits.axis}", f"{size:.4g} {of_force}", speed]
        if limits.approach_speed is not None:
            into = f"at {1e3 * limits.approach_speed:.3g} mm/s into {touched:.4g} N/m"
            yield ["reference", "", f"{into} peaks at {3 * size:.3g} N: approach no faster"]
    if stiffness:
        words = f"{1e3 / stiffness:.3g} mm a newton" if i >= 3 else "holds the turn"
        yield ["stiffness" + along, f"{stiffness:.4g} {wall}", words]
    if wanted is not None and stiffness:
        words = "with a stiffness on the same axis the force is off by K times the deflection"
        yield [f"force.{limits.axis}", "", words]
