"""Verdict on a run, in one line: whether it did what was asked and kept what it was to keep, and if not, why."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.constraints.constraint_view import ConstraintView
from dqcontrol.constraints.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import SELF
from dqcontrol.controller import PreparedTasks
from dqcontrol.experiments.contacts import HAND, contacts_of
from dqcontrol.experiments.outcome import hits, judge
from dqcontrol.experiments.spec import Spec
from dqcontrol.laws import Law, PartialProportional
from dqcontrol.loop.record import Record, has_failed, row_norms
from dqcontrol.loop.signals import DISTANCE, PRESSURE, ROOM, held_poses
from dqcontrol.measures.held import deadlocks
from dqcontrol.measures.metrics import AT_LIMIT, UNSEEN, Metrics, joint_margins
from dqcontrol.measures.run_numbers import DesiredMotion
from dqcontrol.measures.task_result import TaskResult, further_results
from dqcontrol.plants import MobilePlant, MujocoPlant, Plant
from dqcontrol.plants.mobile.mobile_plant import SLIDING
from dqcontrol.plants.mujoco.gripper import GRIP_FORCE, GRIPPER_OPENING
from dqcontrol.plants.sensors import TOUCH_FORCE
from dqcontrol.references.sample import POSE
from dqcontrol.robots import Robot
from dqcontrol.supervisor import list_interventions
from dqcontrol.supervisor.interventions import INTERVENTIONS
from dqcontrol.tables.number_texts import angle_text, length_text, percent_text
from dqcontrol.world import Body, World
from dqcontrol.world.body import INSTANT

Failure = Literal["", "ended", "outcome", "crossed", "contact", "limits", "grip", "task"]
"""In what way a run failed; empty of one that did not."""

_CROSSED = 1e-9  # m or rad: rounding
_LAST = 0.1  # of the time: when a force has settled, if it does
_OFF = 0.1  # of the wanted force: what is farther off is not what was asked, as of a motion that is followed
_ROUNDING = 1e-9  # as a share of a velocity limit
_OFTEN = 0.1  # of the samples
_CLOSED = 1e-3  # m between fingers that have nothing between them
_CLOSING = 0.1  # s in which end effectors close on what they carry
_BEHIND = 0.7  # cosine of 45° between an error and the way: beyond it late rather than beside its way
_STEADILY = 0.9  # of the last twentieth's samples, over which the end effector's speed is taken, too
_ENDED = 0.1  # s before the end of a run
_TURNS_BACK = 0.1  # s; servos, which lag by less, still move away after a constraint has ceased to press
_END = 0.1, 0.2  # of a run, and s at least: where it is looked at whether it shakes
_TURNS = 10.0  # a second: faster than arms are led
_SHAKING = 0.01  # of a velocity limit: ten times what 14 bit encoders make of a gain of 5 1/s
_SAID = 2  # causes in one line
_OF_THE_LAW = 1  # level of its task
_SHAPES = ("circle", "spiral", "square", "drawing")


class Verdict(NamedTuple):
    """What is said of a run.

    Attributes
    ----------
    words
        Causes with their numbers first, then the task, as ``"crossed: ball −98 mm (link1) at 3.1 s; followed"``.
    failure
        In what way it failed; empty if it did what was asked and kept what it was to keep.
    """

    words: str
    failure: Failure


def verdict_of(row: Mapping[str, Any]) -> Verdict:
    """Return what a row of a study says of its run."""
    words, failure = row["verdict"] or row["stopped"], row["failure"]
    return Verdict(str(words), "ended" if failure is None else failure)


def headline(verdicts: Sequence[tuple[str, Verdict]]) -> str:
    """Return the first line on runs: a single one's words, or how many failed, and of one of these why.

    Examples
    --------
    >>> headline([("K", Verdict("reached", "")), ("LQR", Verdict("not reached: rests 9 mm off", "task"))])
    '1 of 2 runs failed: LQR: not reached: rests 9 mm off'
    """
    if len(verdicts) == 1:
        return verdicts[0][1].words
    failed = [(label, verdict.words) for label, verdict in verdicts if verdict.failure]
    if not failed:
        return f"all {len(verdicts)} runs did what was asked: {verdicts[0][0]}: {verdicts[0][1].words}"
    label, words = failed[0]
    return f"{len(failed)} of {len(verdicts)} runs failed: {label}: {words}"


class Judge:
    """Gives verdicts on the runs of one robot, law and plant.

    Parameters
    ----------
    robot, law, plant
        Of the runs; without law and plant of logs.
    spec
        What else is asked of them: reference, supervisor, what stands around, and what is to be true of a run. Where it
        says that, neither touching nor a reference that was left fails.
    tasks
        Its further tasks, made ready.
    desired
        What the samples of the reference ask for, if that is known.
    whole
        Duration of the whole reference, s, before whose end a run may be told to end; 0 or infinite: none is known.
    """

    def __init__(
        self,
        robot: Robot,
        law: Law | None = None,
        plant: Plant | None = None,
        spec: Spec | None = None,
        tasks: PreparedTasks | None = None,
        desired: DesiredMotion | None = None,
        whole: float = 0.0,
    ) -> None:
        self.robot, self.law, self.plant, self.desired = robot, law, plant, desired
        self._supervisor = None if spec is None or plant is None else spec.supervisor_of(plant)
        self._period, self._tasks = 1.0 if spec is None else spec.period, tasks
        self._whole = whole if math.isfinite(whole) else 0.0
        self._constraints: Constraints | None = None if law is None else law.constraints
        reference = None if spec is None else spec.reference
        kind = "" if reference is None else str(reference.__struct_config__.tag)
        self._motion = kind if kind in _SHAPES else "reference"
        planned = getattr(reference, "clear_of", None) is not None
        self._world, self._outcome = (None, ()) if spec is None else (spec.surroundings, spec.outcome or ())
        self._contacts = contacts_of(robot, self._constraints, plant, self._world, fitted=planned)
        physics = plant if isinstance(plant, MobilePlant | MujocoPlant) else None
        around = {} if physics is None or physics.world is None else physics.world.bodies
        self._gripper = None if physics is None else physics.gripper
        self._free = {name: body for name, body in around.items() if body.role == "free"}
        self._containers = {name: body for name, body in around.items() if body.container is not None}

    def verdict(
        self, record: Record, metrics: Metrics, result: TaskResult, skip_initial: float = 0.0
    ) -> Verdict:
        """Return what a run came to.

        Parameters
        ----------
        record, metrics, result
            The run, its numbers, and what its task came to.
        skip_initial
            As for `task_result`.
        """
        if metrics.failure == "ended":
            diverged = "" if has_failed(record.stopped) else "diverged: "
            return Verdict(diverged + record.stopped.partition(";")[0], "ended")
        touched = list(self._touched(record))
        judged = [
            judge(each, record, self.robot, self._world, self._period, touched) for each in self._outcome
        ]
        met = [each.words for each in judged if each.holds]
        hit, grip, missed = hits(record, self.robot), list(self._grip(record)), list(self._missed(record))
        found: list[tuple[Failure, str]] = [
            *(("outcome", f"not so: {each.words}") for each in judged if not each.holds),
            *(("crossed", words) for words in (*self._crossed(record), *self._supervised(record))),
            *(("contact", words) for words in touched),
            *(("contact", words) for words in hit if not self._outcome and not self._may_be_hit(words)),
            *(("limits", words) for words in self._limits(record, metrics)),
            *(("grip", words) for words in missed),
            *(("grip", words) for words in grip if not self._outcome),
            *(("task", words) for words in self._shakes(record, metrics)),
        ]
        pressed = [(words, failed and not self._outcome) for words, failed in self._pressed(record)]
        found.extend(("task", words) for words, failed in pressed if failed)
        further = [] if self._tasks is None else list(self._further(record, self._tasks, skip_initial))
        found.extend(("task", words) for words, failed in further if failed)
        told = [words for words, failed in (*pressed, *further) if not failed]
        lasted = record.duration
        cut = f" (only the first {lasted:.3g} s of {self._whole:.3g} s)" * (
            lasted < self._whole - self._period
        )
        task = metrics.verdict + cut
        met += [
            words.replace("hit ", "pressed on ", 1)
            if (body := self._hit(words)) and body.role == "springy"
            else words
            for words in hit
            if self._outcome or self._may_be_hit(words)
        ]
        met += grip if self._outcome else []
        if self._outcome and not found:
            if hit and isinstance(self.plant, MujocoPlant) and self.plant.impedance:
                task = task.replace("not followed: errs", "gave way", 1)
            cleared = any(each.clear_of is not None for each in self._outcome)
            kept = () if cleared else self._kept(record)
            return Verdict("; ".join([*met, task, *told, *kept, *self._done(record)]), "")
        if task.startswith("not ") and not self._outcome:
            if not found and (left := self._left(record, result)):
                left = f"left the {self._motion} by {left}; back on it at the end{cut}"
                return Verdict("; ".join([*self._kept(record), left, *told]), "")
            cause = next(self._causes(record, metrics, result), "")
            found.append(("task", f"{cause}; {task}" if cause else task))
        elif not found:
            return Verdict("; ".join([task, *told, *met, *self._kept(record), *self._done(record)]), "")
        else:
            found.append(("task", task))
        *breaches, (_, end) = found
        words = [said for _, said in breaches[:_SAID]]
        if len(breaches) > _SAID:
            words.append(f"and {len(breaches) - _SAID} more")
        return Verdict("; ".join([*words, end]), found[0][0])

    def _may_be_hit(self, words: str) -> bool:
        """Return whether what was hit is a body that gives way."""
        body = self._hit(words)
        return body is not None and (body.is_moved_by_physics or body.role == "springy")

    def _hit(self, words: str) -> Body | None:
        name = words.removeprefix("hit ").partition(": ")[0]
        return None if self._world is None else self._world.bodies.get(name)

    # What was to be kept

    def _crossed(self, record: Record) -> Iterator[str]:
        """Yield which constraints were crossed, those that a run starts beyond once they have been kept."""
        if ROOM not in record.readings or self._constraints is None:
            return
        room, distance = record.readings[ROOM], record.readings[DISTANCE].values
        worst = []
        for i, name in enumerate(room.parts):
            values = room.values[:, i]
            kept = np.flatnonzero(values >= -_CROSSED)
            first = len(values) - 1 if not len(kept) else int(kept[0]) if self._constraints.recovery else 0
            at = first + int(np.nanargmin(values[first:]))
            if values[at] < -_CROSSED:
                worst.append((float(values[at]), at, i, name))
        for value, at, i, name in sorted(worst):
            when = _at(record, at)
            if room.units[i] == "rad":
                yield f"crossed: {name} {angle_text(-value)}{when}"
                continue
            link = self._nearest_link(record, at, name)
            if distance[at, i] < 0:
                yield f"crossed: {name} {length_text(float(distance[at, i]))}{link}{when}"
            else:
                asked = length_text(float(distance[at, i]) - value)
                yield f"too near: {name} {length_text(float(distance[at, i]))}{link}, {asked} asked,{when}"

    def _nearest_link(self, record: Record, at: int, name: str) -> str:
        """Return the link that is nearest to a constraint at a sample, in brackets; nothing if it is another's."""
        assert self._constraints is not None
        pair = ConstraintView(self._constraints, self.robot, self._period).nearest(
            record.q[at], float(record.time[at])
        )
        label = "" if pair is None else pair.label.removeprefix(f"{name}: ")
        return f" ({label})" if pair is not None and (name == SELF or label != pair.label) else ""

    def _supervised(self, record: Record) -> Iterator[str]:
        """Yield where base or end effector left their zones or box by more than the supervisor tolerates."""
        given = self._supervisor
        if given is None:
            return
        if given.keep_out is not None:
            radius = given.keep_out.footprint_of(self.robot)
            base = record.q[:, self.robot.bases[0][0] :][:, :2]
            for name, taken in given.keep_out.footprints.items():
                room = taken.clearance(base) - radius
                if (k := int(room.argmin())) >= 0 and room[k] < -_CROSSED:
                    yield f"crossed: {name} {length_text(float(room[k]))} (base){_at(record, k)}"
        if (box := given.workspace) is not None:
            out = np.maximum(np.array(box.lower) - record.position, record.position - np.array(box.upper))
            beyond = out.max(axis=1)
            if beyond[k := int(beyond.argmax())] > given.measured_tolerance:
                yield f"crossed: workspace {length_text(-float(beyond[k]))} ({HAND}){_at(record, k)}"

    def _touched(self, record: Record) -> Iterator[str]:
        found = self._contacts.of_run(record)
        told: set[str] = set()
        for each in found:  # of each thing the link that went deepest
            thing, _, link = each.words.partition(": ")
            if thing not in told:
                told.add(thing)
                yield f"{thing}: {link} {length_text(-each.depth)} at {each.time:.3g} s"

    def _limits(self, record: Record, metrics: Metrics) -> Iterator[str]:
        if metrics.limit_margin < -UNSEEN:
            i = record.joint_names.index(metrics.limit_joint)
            k = int(joint_margins(record, self.robot.limits)[i].argmin())
            turns = self.robot.joint_types[i] == "revolute"
            beyond = -metrics.limit_margin
            by = angle_text(beyond) if turns else length_text(beyond)
            yield f"beyond its limit: {metrics.limit_joint} by {by}{_at(record, k)}"
        if metrics.peak_velocity_share > 1 + _ROUNDING:
            shares = np.abs(record.command[:-1]) / self.robot.limits.velocity
            k, i = np.unravel_index(int(shares.argmax()), shares.shape)
            name = record.input_names[i]
            share = percent_text(metrics.peak_velocity_share, 4)
            yield f"too fast: {name} commanded at {share} of its velocity limit{_at(record, int(k))}"

    def _grip(self, record: Record) -> Iterator[str]:
        """Yield what was to be gripped, carried and placed, and was not."""
        if GRIP_FORCE in record.readings:
            internal = record.readings[GRIP_FORCE].values.min(axis=1)
            held = np.flatnonzero((internal > 0) & (record.time >= _CLOSING))
            lost = np.flatnonzero(internal[held[0] :] <= 0) if len(held) else np.zeros(1, dtype=np.intp)
            if len(lost):
                yield f"let go of the box{_at(record, int(held[0] + lost[0]) if len(held) else 0)}"
        gripper = self._gripper
        if gripper is None or not self._free:
            return
        opening = record.readings[GRIPPER_OPENING].values.min(axis=1)
        end = float(record.time[-1])
        times = [event for event in gripper.schedule if event.time < end]
        holds = [(a.time, b.time if b else end) for a, b in pairwise([*times, None]) if a and a.closed]
        free = gripper.opening / gripper.speed  # s; twice as long as it takes to close on nothing
        for begin, until in holds:
            there = np.flatnonzero((record.time >= begin) & (record.time <= until))
            closed = opening[there] < _CLOSED
            if len(there) and closed[-1]:
                lost = float(record.time[there[int(closed.argmax())]])
                dropped = lost > begin + free
                yield f"dropped at {lost:.3g} s" if dropped else f"gripped nothing at {begin:.3g} s"
        if self._containers and any(until < end for _, until in holds):
            yield from self._not_placed(record, len(holds))

    def _missed(self, record: Record) -> Iterator[str]:
        """Yield what hands grip that is elsewhere, and what they put elsewhere, by more than the world says."""
        bodies = {} if self._world is None else self._world.bodies
        for name, body in bodies.items():
            held = body.held
            if held is None:
                continue
            alone = World(bodies={name: body})
            prepared = Constraints(world=alone, self_collision=False)
            kept = prepared.prepare(self.robot, self._period, "measured")
            known = record.readings.get(f"{name}_position") if body.mass is not None else None
            for time, stands, words in (
                (held.since, body, "gripped nothing: {} is {} from where the hand closes on it"),
                (held.ends, body.put_down, "put elsewhere: {} is {} from where it is to be"),
            ):
                if stands is None or time > record.time[-1]:
                    continue
                k = int(np.searchsorted(record.time, time - INSTANT))
                pose = held_poses(kept, name, record.q[k : k + 1], np.array([held.since]))[0]
                place, other = algebra.translation(pose), np.array(stands.position)
                if known is not None and stands is body:  # physics says where it is
                    other = known.values[k]
                elif known is not None:
                    place = known.values[k]
                away = float(np.linalg.norm(place - other))
                if away > held.within:
                    yield words.format(name, length_text(away)) + _at(record, k)

    def _not_placed(self, record: Record, carried: int) -> Iterator[str]:
        """Yield the body that is nearest to a container, and in none, if fewer are in one than were gripped."""
        outside = {}
        for name in self._free:
            place = record.readings[f"{name}_position"].values[-1]
            away = {other: float(body.away(place)) for other, body in self._containers.items()}
            nearest = min(away, key=lambda other: away[other])
            if away[nearest] > 0:
                outside[name] = nearest, away[nearest]
        if len(self._free) - len(outside) < min(carried, len(self._free)):
            name = min(outside, key=lambda each: outside[each][1])
            yield f"not placed: {name} {length_text(outside[name][1])} from {outside[name][0]}"

    def _shakes(self, record: Record, metrics: Metrics) -> Iterator[str]:
        """Yield which input goes back and forth at the end of a run most, and what the supervisor held it by."""
        if not metrics.peak_velocity_share > _SHAKING:
            return
        share, least = _END
        first = int(record.time.searchsorted(record.time[-1] - max(share * record.duration, least)))
        command = record.command[first:-1]
        lasted = float(record.time[-1] - record.time[first])
        turns = (command[1:] * command[:-1] < 0).sum(axis=0) / lasted
        if not (turns >= _TURNS).any():
            return
        sizes = np.abs(command).mean(axis=0) / self.robot.limits.velocity
        shaking = (turns >= _TURNS) & (sizes > _SHAKING)
        if shaking.any():
            i = int(np.where(shaking, sizes, 0.0).argmax())
            yield (
                f"shakes: {record.input_names[i]} turns back {turns[i]:.0f} times a second, at "
                f"{percent_text(sizes[i], 3)} of its velocity limit on average"
            )
            if held := _braked(record):
                yield held

    def _pressed(self, record: Record) -> Iterator[tuple[str, bool]]:
        """Yield the force along each axis that controls one, and whether it is far from what is wanted at the end."""
        if self.law is None or self.law.contact is None or TOUCH_FORCE not in record.readings:
            return
        contact = self.law.contact
        force = contact.turned_to_axes(
            record.readings[TOUCH_FORCE].values, record.pose, record.desired[:, POSE]
        )
        first = len(record) - max(1, int(_LAST * len(record)))
        for axis, wanted in contact.wanted_forces(record.time).items():
            felt_at, asked = force[first:, "xyz".index(axis)].mean(), wanted[first:].mean()
            touching = np.flatnonzero(np.abs(force).max(axis=1) > 0)
            words = "touched nothing"
            if len(touching):
                words = f"presses {felt_at:.3g} N along {axis}, {asked:.3g} asked"
                if tare := contact.sensor.tare:
                    words += f" (tared {record.time[touching[0]] - tare:.2g} s before it touched)"
            yield words, abs(felt_at - asked) > _OFF * abs(asked)

    def _further(
        self, record: Record, tasks: PreparedTasks, skip_initial: float
    ) -> Iterator[tuple[str, bool]]:
        """Yield what came of each further task, and whether the run failed by it.

        Those on levels after the law's are done as far as the others leave room, and are told of only.
        """
        levels = dict(zip(tasks.labels, tasks.levels, strict=True))
        for label, result in further_results(record, tasks, skip_initial).items():
            yield f"{label}: {result.words}", not result.succeeded and levels[label] <= _OF_THE_LAW

    def _kept(self, record: Record) -> Iterator[str]:
        """Yield the constraint that had least room."""
        if ROOM not in record.readings or self._constraints is None:
            return
        room, distance = record.readings[ROOM], record.readings[DISTANCE].values
        least = np.nanmin(room.values, axis=0)
        i = int(np.argmin(np.where(np.array(room.units) == "m", least, np.inf)))
        if room.units[i] != "m":
            i = int(least.argmin())
            yield f"kept {room.parts[i]} ({angle_text(least[i])} left)"
            return
        name, at = room.parts[i], int(np.nanargmin(room.values[:, i]))
        near = float(distance[at, i])
        if name in self._constraints.zones:
            yield f"kept in {name} ({length_text(near)} left)"
        else:
            what = "itself" if name == SELF else f"the {name}"
            asked = near - float(least[i])
            alike = max(near, asked) < 1  # m: both are said in mm
            least_asked = f"{1e3 * asked:.3g}" if alike else length_text(asked)
            yield f"kept clear of {what} ({length_text(near)}, {least_asked} asked)"

    def _done(self, record: Record) -> Iterator[str]:
        """Yield what else was to be done, and was."""
        if GRIP_FORCE in record.readings and not any(self._grip(record)):
            yield "held the box"
        if self._gripper is not None and self._gripper.schedule and self._free:
            places = [record.readings[f"{name}_position"].values[-1] for name in self._free]
            held = [any(body.holds(place) for body in self._containers.values()) for place in places]
            yield f"placed {sum(held)} of {len(places)}" if any(held) else "gripped"
        if isinstance(self.plant, MobilePlant):
            yield f"stands (tilt ≤ {math.degrees(float(record.readings['tilt'].values.max())):.2g}°)"

    # Why a task was not done

    def _left(self, record: Record, result: TaskResult) -> str:
        """Return by how much constraints took the end effector away from its reference, if it is back at the end."""
        if PRESSURE not in record.readings or not self._kept_hand(record):
            return ""
        # What is not judged is NaN.
        far_off = math.isfinite(result.position) and record.position_error[-1] > result.position_tolerance
        turned_off = record.orientation_error[-1] > result.orientation_tolerance
        if far_off or (math.isfinite(result.orientation) and turned_off):
            return ""
        far, turned = float(record.position_error.max()), float(record.orientation_error.max())
        mainly = result.position > result.position_tolerance
        return f"{length_text(far, 2) if mainly else angle_text(turned)} at most"

    def _kept_hand(self, record: Record) -> bool:
        """Return whether the end effector was farthest from its reference while a constraint pressed, or just after."""
        pressed = np.flatnonzero((record.readings[PRESSURE].values > 0).any(axis=1))
        farthest = record.time[int(record.error.argmax())]
        return bool(len(pressed)) and bool(np.abs(record.time[pressed] - farthest).min() <= _TURNS_BACK)

    def _causes(self, record: Record, metrics: Metrics, result: TaskResult) -> Iterator[str]:
        """Yield what held the end effector, what is most to the point first."""
        if (held := deadlocks(record)) and held[-1].end >= record.time[-1] - _ENDED:
            yield f"held by {' and '.join(held[-1].names[:2])} since {held[-1].begin:.3g} s"
        elif PRESSURE in record.readings and (pressed := record.readings[PRESSURE]).values[-2:].any():
            yield f"held by {pressed.parts[int(pressed.values[-2:].sum(axis=0).argmax())]} at the end"
        elif PRESSURE in record.readings and self._kept_hand(record):
            shares = (record.readings[PRESSURE].values > 0).mean(axis=0)
            name = record.readings[PRESSURE].parts[int(shares.argmax())]
            yield f"pushed aside by {name} for {percent_text(shares.max())} of the time"
        yield from (words for words in hits(record, self.robot) if self._may_be_hit(words))
        if "wheel_slip" in record.readings:
            slip = np.abs(record.readings["wheel_slip"].values).max(axis=1)
            if (share := float(np.mean(slip > SLIDING))) > _OFTEN:
                yield f"slipping: wheels slide at up to {slip.max():.2g} m/s, for {percent_text(share)} of the time"
        if metrics.saturation > _OFTEN:
            shares = np.abs(record.command[:-1]) / self.robot.limits.velocity >= 1 - _ROUNDING
            often = shares.mean(axis=0)
            name = record.input_names[int(often.argmax())]
            yield f"saturated: {name} at its velocity limit for {percent_text(often.max())} of the time"
        if words := _braked(record):
            yield words
        if result.at_rest and not result.is_moving:
            yield from self._rests(record, metrics, result)
        elif behind := _behind(record, result, DesiredMotion.of(record.desired, self.desired)):
            yield f"too late: {length_text(behind)} behind"

    def _rests(self, record: Record, metrics: Metrics, result: TaskResult) -> Iterator[str]:
        """Yield why an end effector rests before its goal."""
        if result.is_singular:
            return  # it is said where it rests
        partial = isinstance(self.law, PartialProportional)
        if self.robot.input_size < 6 and not partial:
            yield f"{self.robot.name} has {self.robot.input_size} inputs, and a pose takes 6"
        elif not partial and not self.robot.solve(record.desired[-1, POSE], record.q[-1]).success:
            missing = record.position_error[-1]
            yield f"out of reach: rests {length_text(float(missing))} short"
        elif metrics.limit_margin < AT_LIMIT:
            yield f"at its limit: {metrics.limit_joint}"


def _braked(record: Record) -> str:
    """Say for what the supervisor held a robot back longest, if it did often."""
    if INTERVENTIONS not in record.readings:
        return ""
    lasted: dict[str, float] = {}
    for begin, end, reason in list_interventions(record.time, record.readings[INTERVENTIONS].values):
        lasted[reason] = lasted.get(reason, 0.0) + end - begin
    reason = max(lasted, key=lambda each: lasted[each], default="")
    share = lasted.get(reason, 0.0) / max(record.duration, 1e-9)
    return f"held by the supervisor: {reason} for {percent_text(share)} of the time" if share > _OFTEN else ""


def _behind(record: Record, result: TaskResult, desired: DesiredMotion) -> float:
    """Return by how much the end effector is behind on its way, m: the mean while the reference moves, or what is left.

    Of a reference at rest only an end effector that comes nearer all the time is behind: others hang or sway beside
    their goal.
    """
    if result.at_rest:
        steps = np.diff(record.position_error[-max(2, len(record) // 20) :])
        comes = np.mean(steps < 0) > _STEADILY and result.position > result.position_tolerance
        return float(record.position_error[-1]) if comes else 0.0
    moves, ahead = desired.directions
    if not len(ahead) or not result.position > result.position_tolerance:
        return 0.0
    error = (desired.positions - record.position)[moves]
    mean = float(np.einsum("ij,ij->i", error, ahead).mean())
    return mean if mean > _BEHIND * float(row_norms(error).mean()) else 0.0


def _at(record: Record, sample: int) -> str:
    return f" at {record.time[sample]:.3g} s"
