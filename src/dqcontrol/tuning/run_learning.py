"""Repeats of one motion, each with a reference shifted by what the ones before it missed."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import NoteWarning, ReachError, ShapeError, ValueRangeError
from dqcontrol.experiments.check import driven_model
from dqcontrol.experiments.contact_check import sensed, stiffness_touched
from dqcontrol.experiments.feasibility import path_demand
from dqcontrol.experiments.prepared_experiment import PreparedExperiment, prepare_spec
from dqcontrol.experiments.result_pages import result_pages
from dqcontrol.experiments.results_folder import SavedTable, WorkingFolder, check_new, told_first
from dqcontrol.experiments.run_comparison import write_table
from dqcontrol.experiments.spec.spec_files import write_spec
from dqcontrol.files.output_file import finite_or_none, write_json, yaml_text
from dqcontrol.loop import Clock, Record, has_failed, simulate_prepared
from dqcontrol.measures.metrics import low_passed
from dqcontrol.measures.stability import GOOD_MARGIN, gain_margin
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import WRENCH_READINGS, Plant
from dqcontrol.recording import load_record, save_record
from dqcontrol.references import POSE, TIME, TWIST, Points, Previewed
from dqcontrol.tables.tables import Column, Table
from dqcontrol.tuning import learnt_motion
from dqcontrol.tuning.learning_convergence import (
    HIGHEST,
    Convergence,
    ForceShape,
    LoopShape,
    loop_shape,
    widest,
)
from dqcontrol.tuning.spec_blocks import LearnProblem, plant_family, read_learn

LEARNT, LEARNT_SPEC, HISTORY = "learnt.csv", "learnt.yaml", "learning.json"
LearnProgress = Callable[[int, int], None]
MotionRunner = Callable[["LearnProblem", Points | None, int], Record]
"""Runs a motion on a robot that is no simulation, and takes the robot back to the start: the problem, the motion (None:
that of the spec), the number of the run. Its record has the measured joints, over the reference's own time, and where a
tracker is to measure the reading `TRACKED_POSE`."""
_CLOSED = 1e-3, math.radians(0.5)  # m and rad, within which a motion ends where it starts
_JUMP = 0.02  # m/s, and rad/s, of a motion that begins at rest
_GROWN, _GAIN = 1.1, 0.9  # of the best error: what is growth, and what is progress
_NARROWER, _WEAKER = 0.6, 0.5  # after growth: the cut-off, and what is learnt of an error
# times the noise in the band: what is taken for noise, and what is not any more
_AT_NOISE, _LEFT_NOISE = 1.5, 3.0
_MOST_FLAT = 2  # repeats without progress in a row: one may be noise
_SAME = 1.001  # is no growth: what is not learnt stays as it is
_MISSING = 2.5  # periods at the end that a robot's record may lack
_HIDDEN = 1.3  # times what encoders see: less is not worth a word
_NOISE = "what is left is the sensors' noise"
_TRUSTED = 3  # accepted repeats from which on increments are averaged


@dataclass(frozen=True)
class LearningRun:
    """One run of the motion.

    Attributes
    ----------
    number
        0 is the first, with nothing learnt.
    position, orientation
        Root mean square of the end effector's true errors, mm and degrees, without the start that is skipped.
    peak
        Largest true error of the position, mm.
    seen
        Root mean square of the position's error as it was measured, mm.
    learnable
        The error below the cut-off that the sensors see, turns as ways, mm.
    noise
        What of it is noise, estimated from what lies above the cut-off, mm.
    cutoff
        Hz, with which the next motion is learnt.
    peak_command
        Largest input, rad/s or m/s.
    force
        Root mean square of the force's error, N, along axes with a wanted one: the true one, or where the plant does
        not know it the measured one; None where no force is wanted. Errors of position are then those along the axes
        that follow the plan, and ``learnable`` and ``noise`` are of the force, N.
    outcome
        ``"first"``, ``"accepted"``, ``"flat"``, ``"grown"``; or ``"averaged"``: what was left before was noise, and
        the increments of the repeats since then are averaged.
    """

    number: int
    position: float
    orientation: float
    peak: float
    seen: float
    learnable: float
    noise: float
    cutoff: float
    peak_command: float
    outcome: str
    force: float | None = None


@dataclass(frozen=True)
class Learning(SavedTable):
    """What was learnt.

    Attributes
    ----------
    problem
        What was asked for.
    convergence
        Of the learning operator.
    repeats
        All runs.
    best
        Number of the best one, whose motion is returned: the last that was averaged, as errors at the noise do not tell
        which is best.
    motion
        The learnt motion; of the first run, its samples.
    stopped
        Why there are no more repeats.
    margin
        By how much the law's gain could be multiplied, as the model says.
    first, last
        Records of the first run and of the best.
    forces
        How forces were learnt; None where none is wanted.
    notes
        What is to be known of it.
    """

    problem: LearnProblem
    convergence: Convergence
    repeats: tuple[LearningRun, ...]
    best: int
    motion: Points
    stopped: str
    margin: float
    first: Record = field(repr=False)
    last: Record = field(repr=False)
    forces: learnt_motion.ForceLearning | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()

    @property
    def gain(self) -> float:
        """How many times smaller the error of the best repeat is than that of the first run: of a wanted force's."""
        first, best = self.repeats[0], self.repeats[self.best]
        if first.force is not None and best.force is not None:
            return first.force / best.force
        return first.position / best.position

    def table(self) -> Table:
        """Return one row a repeat."""
        forced = self.repeats[0].force is not None
        rows = (
            [
                (Column("repeat"), each.number),
                *([(Column("force error RMS", "N", ".3g"), each.force)] if forced else []),
                (Column("position error RMS", "mm", ".3g"), each.position),
                (Column("peak", "mm", ".3g"), each.peak),
                (Column("orientation error RMS", "°", ".3g"), each.orientation),
                (Column("as measured", "mm", ".3g"), each.seen),
                (Column("noise in the band", "N" if forced else "mm", ".2g"), each.noise),
                (Column("cut-off", "Hz", ".3g"), each.cutoff),
                (Column("peak |u|", "rad/s or m/s", ".3g"), each.peak_command),
                (Column("outcome"), each.outcome + ", kept" * (each.number == self.best)),
            ]
            for each in self.repeats
        )
        return Table.of(rows, f"{self.problem.spec.name}: learning from repetition")

    def remarks(self) -> list[str]:
        """Say what was expected, and why it ended."""
        operators = self.forces.by_axis.values() if self.forces else ()
        factor, frequency = max(each.worst for each in (self.convergence, *operators))
        most = f" by more than {factor:.3g} a repeat (at {frequency:.2g} Hz)" if factor > _SAME else ""
        return [
            f"condition: errors of no frequency grow{most}; learnt up to {self.convergence.cutoff:.2g} Hz",
            f"loop: its gain could be multiplied by {self.margin:.3g}, as the model says",
            f"noise: each repeat puts {self.convergence.noise_factor:.2g} × the noise of its measurement into the "
            "motion",
            *self.notes,
            f"ended: {self.stopped}",
            *(["gained: nothing; the reference stays that of the spec"] if not self.best else []),
        ]

    def spec(self, file: str | Path = LEARNT) -> dict[str, Any]:
        """Return the spec of a run of the learnt motion, as plain data; the one given where nothing was gained."""
        return self.problem.data | ({"reference": self.problem.points(file)} if self.best else {})

    def write(self, folder: Path) -> None:
        """Write the learnt motion, a spec that runs it, the table, figures and a report into an existing folder."""
        text = _text(self.problem)
        write_spec(text, folder)
        law = json.dumps(self.problem.data.get("law") or self.problem.data.get("laws"))
        plant = json.dumps(self.problem.data.get("plant") or self.problem.data.get("plants"))
        notes = (
            f"learnt in {self.best} repeats; another loop needs another motion: replay it with the same law and plant",
            f"law: {law}",
            f"plant: {plant}",
        )
        if self.best:
            learnt_motion.write_motion(folder / LEARNT, self.motion, notes)
        (folder / LEARNT_SPEC).write_text(yaml_text(self.spec()), encoding="utf-8")
        history = {
            "repeats": [asdict(each) for each in self.repeats],
            "best": self.best,
            "stopped": self.stopped,
            "cutoff": self.convergence.cutoff,
            "worst_factor": self.convergence.worst[0],
            "worst_frequency": self.convergence.worst[1],
            "noise_factor": self.convergence.noise_factor,
            "margin": finite_or_none(self.margin),
            "notes": list(self.notes),
        }
        write_json(folder / HISTORY, history)
        write_table(self.table(), folder, "learning")
        result_pages().write_learning_report(self, text, folder)


def learn(
    source: str | Path | dict[str, Any],
    repeats: int | None = None,
    *,
    real_time: bool = False,
    runner: MotionRunner | None = None,
    progress: LearnProgress | None = None,
    journal: str | Path | None = None,
    **block: Any,
) -> Learning:
    """Run a motion, and shift its reference from repeat to repeat until the end effector goes where it should.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary, with one law, robot and plant, and perhaps the block
        ``learn``; see `LearnBlock`.
    repeats
        Most repeats after the first run; default: that of the block, 5.
    real_time
        True: each run on the clock.
    runner
        What runs motions in place of the spec's plant, as ``dqcontrol.ros2.repeated_motion.RobotBehindTopics``.
    progress
        Called with runs done, and at most.
    journal
        Working folder that keeps the records of runs in simulation, so that the same call resumes after an
        interruption; it stays there when all is learnt. Needs pyarrow.
    **block
        Keys of ``learn`` that differ.

    Raises
    ------
    Error
        If something is missing, malformed or does not fit; if the motion ends elsewhere than it starts, begins with a
        jump or meets limits of speed; or if learning would not converge, as the model says: before anything moves.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> found = dqc.learn({
    ...     "name": "again", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
    ...     "reference": {"kind": "circle", "radius": 0.05, "duration": 2, "ramp": 0.5},
    ...     "law": {"kind": "proportional", "gain": 5}, "plant": {"kind": "servo", "delay": 0.02},
    ... }, repeats=2)
    >>> found.gain > 20
    True
    """
    problem = read_learn(source, repeats=repeats, **block)
    if runner is not None and real_time:
        raise ValueRangeError("real_time: a robot behind a runner is always in real time; leave it out")
    if journal is not None and (runner is not None or real_time):
        raise ValueRangeError("journal: runs on the clock are not resumed; leave it out")
    session = _Session(problem, real_time=real_time, runner=runner)
    report = progress or (lambda done, total: None)
    if journal is None:
        return session.run(report)
    with WorkingFolder(Path(journal), _text(problem), session.setting.fingerprint()) as session.kept:
        return session.run(report)


def learn_to(
    source: str | Path | dict[str, Any],
    folder: str | Path,
    repeats: int | None = None,
    *,
    force: bool = False,
    real_time: bool = False,
    runner: MotionRunner | None = None,
    progress: LearnProgress | None = None,
    computed: Callable[[Learning], None] | None = None,
) -> Learning:
    """Do the same, and write a folder of results; see `Learning.save`.

    ``computed`` is called with what was learnt before that.
    """
    check_new(folder, force=force)
    found = learn(source, repeats, real_time=real_time, runner=runner, progress=progress)
    with told_first(computed, found):
        found.save(folder, force=force)
    return found


class _Session:
    """A motion that is repeated: made ready and checked before anything moves."""

    def __init__(self, problem: LearnProblem, *, real_time: bool, runner: MotionRunner | None) -> None:
        self.problem, self.real_time, self._runner = problem, real_time, runner
        self.setting: PreparedExperiment = prepare_spec(problem.spec, problem.folder, {})
        (self.case,) = self.setting.cases
        self.samples = self.setting.scene.samples
        self.time = self.samples[:, TIME]
        self.notes: list[str] = []
        self._skip = problem.block.skip
        self.weights = learnt_motion.start_weights(self.time, self._skip)
        self._check_motion()
        self._models, self._uncertain = self._plants()
        scene = self.case.scene
        self._law = self.case.prepare_law(problem.spec)
        shape = loop_shape(scene.robot, self._law, self.case.gains, scene.start, scene.reference)
        self.margin = self._margin()
        self.convergence = self._convergence(shape)
        self.forces = self._force_learning(shape)
        self._warn_near_limit()
        self._delay = problem.block.sensor_delay / problem.spec.period
        self.kept: WorkingFolder | None = None

    def _check_motion(self) -> None:
        """Raise if the motion cannot be repeated, or what it asks cannot be learnt."""
        block, samples, where = self.problem.block, self.samples, self.problem.where
        if len(samples) < 20:
            raise ValueRangeError(f"{where}: duration: takes {len(samples)} samples; learning needs 20")
        ((*turn, x, y, z),) = learnt_motion.hand_error(samples[:1, POSE], samples[-1:, POSE])
        way, angle = math.hypot(x, y, z), math.hypot(*turn)
        if (way > _CLOSED[0] or angle > _CLOSED[1]) and block.return_time is None:
            raise ValueRangeError(
                f"{where}: reference: ends {1e3 * way:.3g} mm and {math.degrees(angle):.2f}° from where it starts, so "
                "it cannot be repeated; give learn.return_time, in which the end effector goes back"
            )
        twist = samples[0, TWIST]
        px = algebra.translation(samples[0, POSE])
        speed = float(np.linalg.norm(twist[3:] + np.cross(twist[:3], px)))
        turning = float(np.linalg.norm(twist[:3]))
        if max(speed, turning) > _JUMP and not block.skip:
            raise ValueRangeError(
                f"{where}: reference: begins at {1e3 * speed:.3g} mm/s and {math.degrees(turning):.2f} °/s, and the "
                "jump would be learnt; let it begin at rest (reference.ramp), or give learn.skip"
            )
        demand = path_demand(self.setting.scene)
        if demand is not None and demand.peak_share > 1:
            raise ReachError(
                f"{where}: reference: asks {demand.joint} for {demand.peak_share:.3g} × its largest speed at "
                f"{demand.time:.3g} s, and saturation cannot be learnt; slow it down"
            )

    def _plants(self) -> tuple[list[LinearModel], str]:
        """Return what the plant may be, the nominal one first, and in words how uncertain that is."""
        problem, block, scene = self.problem, self.problem.block, self.case.scene
        model: Plant = self.case.plant if block.model is None else block.model
        period, field = problem.spec.period, "learn.uncertainty"
        family = plant_family(model, block.uncertainty, 0.0, period, problem.identified, field)
        models = []
        for plant in family.plants:
            linear, _ = driven_model(problem.spec, plant, scene.robot, scene.start)
            if linear is None:
                raise ShapeError(
                    f"{problem.where}: learn.model: {type(plant).__name__} has no linear model; give one, as a servo "
                    "that dqcontrol identify found"
                )
            models.append(linear)
        by = f" if lags differ by {100 * family.lag:.3g} % and delays by {1e3 * family.delay:.3g} ms"
        return models, by if family.lag or family.delay else ""

    def _margin(self) -> float:
        """Return by how much the law's gain could be multiplied; raise if its loop is unstable."""
        period, gains = self.problem.spec.period, self.case.gains or ()
        margin = min(gain_margin(gain, each, period) for gain in gains for each in self._models)
        if margin <= 1:
            raise ValueRangeError(
                f"{self.problem.where}: law: its loop is unstable with the model{self._uncertain}: only {margin:.3g} × "
                "its gain is stable, and nothing can be said of how it answers a shift; choose less"
            )
        return margin

    def _warn_near_limit(self) -> None:
        """Say so if the loop is nearly unstable."""
        if self.margin < GOOD_MARGIN:
            warnings.warn(
                f"{self.problem.where}: law: {self.margin:.3g} × its gain makes the loop unstable, as the model says"
                f"{self._uncertain}, and what is learnt may make it swing; {self.margin / GOOD_MARGIN:.2g} × its gain, "
                "or less, is well within",
                NoteWarning,
                stacklevel=2,
            )

    def _force_learning(self, shape: LoopShape) -> learnt_motion.ForceLearning | None:
        """Return how the force axes learn, None where no force is wanted; the plan's axes learn up to as high then."""
        spec, contact = self.problem.spec, self.case.variant.law.contact
        axes = [] if contact is None else [i for i in (3, 4, 5) if contact.force.components[i] is not None]
        if contact is None or not axes:
            return None
        if self.case.scene.reference.guards.moves:
            raise ValueRangeError(
                f"{self.problem.where}: reference: 'until' and 'touch' end when something is touched, and a learnt "
                "motion takes the same time again; leave them out"
            )
        by_axis, filter_, stiffness = {}, sensed(self.case).sensor.filter, stiffness_touched(spec)
        for axis in axes:
            mass, damping, given = contact.axis_rows[axis].tolist()
            law: dict[str, Any] = vars(shape)
            rows = {"mass": mass, "damping": damping, "given_stiffness": given, "filter": filter_}
            forced = ForceShape(**law, **rows, stiffness=stiffness)
            factors = learnt_motion.STIFFNESSES
            others = tuple(replace(forced, stiffness=factor * stiffness) for factor in factors)
            by_axis[axis] = self._convergence(forced, others if self._uncertain else ())
        lowest = min(each.cutoff for each in (self.convergence, *by_axis.values()))
        self.convergence = replace(self.convergence, cutoff=lowest)
        by_axis = {axis: replace(each, cutoff=lowest) for axis, each in by_axis.items()}
        return learnt_motion.ForceLearning(contact, self.case.scene.robot, by_axis)

    def _convergence(self, shape: LoopShape, others: tuple[LoopShape, ...] = ()) -> Convergence:
        """Return the learning operator, or raise if it does not converge."""
        problem, block = self.problem, self.problem.block
        if block.cutoff is not None:
            found = Convergence(shape, tuple(self._models), block.caution, block.cutoff, others)
            if (frequency := found.breaks_at) is not None:
                factor, at = found.worst
                raise ValueRangeError(
                    f"{problem.where}: learn.cutoff: with {block.cutoff:g} Hz errors grow from {frequency:.2g} Hz on, "
                    f"by {factor:.3g} a repeat at {at:.2g} Hz{self._uncertain}; choose a lower one"
                )
            return found
        found = widest(shape, self._models, block.caution, highest=HIGHEST, others=others)
        if found is None:
            raise ValueRangeError(
                f"{problem.where}: learn: does not converge at any cut-off from 0.1 Hz on"
                f"{self._uncertain}: the model is not sure enough"
            )
        return found

    def run(self, progress: LearnProgress) -> Learning:
        """Run until the error does not shrink or the repeats are over; average over those that only see noise."""
        block = self.problem.block
        count = len(self.time)
        shift, best_shift = np.zeros((count, 6)), np.zeros((count, 6))
        best_error, best_size, best = np.zeros((count, 6)), math.inf, 0
        convergence, accepted, flat, stopped = self.convergence, 0, 0, "all repeats are done"
        strength, at_noise = 1.0, 0  # of learning; repeats whose errors were noise
        repeats: list[LearningRun] = []
        first = last = None
        motion = learnt_motion.motion_of(self.samples, shift)
        progress(0, block.repeats + 1)
        for number in range(block.repeats + 1):
            record = self._execute(learnt_motion.motion_of(self.samples, shift) if number else None, number)
            progress(number + 1, block.repeats + 1)
            if has_failed(record.stopped) or len(record) < count:
                if number == 0:
                    raise ShapeError(f"{self.problem.where}: the first run ended early: {record.stopped}")
                stopped = f"repeat {number} {record.stopped}; what was best before is kept"
                break
            error, judged = self._seen(record, number)
            size, noise = self._sizes(judged, convergence.cutoff)
            outcome = "first"
            if at_noise and size < _LEFT_NOISE * noise:
                outcome = "averaged"
            elif number:
                outcome = _outcome(size, best_size, noise)
                flat = 0 if size < _GAIN * best_size else flat + 1
            if outcome in ("first", "accepted", "averaged"):
                accepted += outcome == "accepted"
                best, best_size, best_error, best_shift = number, size, error, shift
                motion, last = learnt_motion.motion_of(self.samples, shift), record
            elif outcome == "grown":
                convergence = replace(convergence, cutoff=_NARROWER * convergence.cutoff)
                strength *= _WEAKER
            repeats.append(self._repeat(record, error, number, size, noise, convergence.cutoff, outcome))
            first = first or record
            if best_size < _AT_NOISE * noise or outcome == "averaged":
                at_noise, stopped = at_noise + 1, _NOISE
            elif at_noise:
                stopped = f"repeat {number} left the noise; what was best before is kept"
                break
            elif flat >= _MOST_FLAT:
                stopped = "two repeats brought less than 10 %"
                if outcome == "grown":
                    stopped = "errors grew again, though less was learnt; what was best before is kept"
                break
            step = 1.0 if accepted < _TRUSTED else 1.0 / (accepted - 1)
            if at_noise:
                step = 1.0 / (1 + at_noise)
            shift = best_shift + strength * step * self._asked(convergence, self.weights * best_error)
        assert first is not None
        assert last is not None
        self._say_what_is_hidden(repeats[best])
        return Learning(
            problem=self.problem,
            convergence=self.convergence,
            repeats=tuple(repeats),
            best=best,
            motion=motion,
            stopped=stopped,
            margin=self.margin,
            first=first,
            last=last,
            forces=self.forces,
            notes=tuple(self.notes),
        )

    def _asked(self, convergence: Convergence, error: Array) -> Array:
        """Return the change of the shift that an error asks for."""
        if self.forces is None:
            return learnt_motion.increment(convergence, self.time, error)
        asked = self.forces.increment(convergence, self.time, error)
        return self.forces.turned(asked, self.samples[:, POSE], back=True)

    def _sampled(self, motion: Points) -> Array:
        """Return a motion as the law is given it to follow: with twists that lead as those of the spec's do."""
        asked, scene = self.case.scene.reference, self.case.scene
        if isinstance(asked, Previewed):
            return scene.along(Previewed(motion, asked.delay, asked.lag, asked.step)).samples
        return scene.along(motion).samples

    def _execute(self, motion: Points | None, number: int) -> Record:
        """Run a motion, or that of the spec; or give the record of the run that an earlier call has kept."""
        samples = self.case.scene.samples if motion is None else self._sampled(motion)
        if self._runner is not None:
            return self._aligned(self._runner(self.problem, motion, number), samples)
        file = self.kept.recordings / str(number) / "record.mcap" if self.kept else None
        if file and file.exists():
            return load_record(file)
        record = self._simulated(samples, number)
        if file:
            save_record(record, file)
        return record

    def _simulated(self, samples: Array, number: int) -> Record:
        spec, case = self.problem.spec, self.case
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NoteWarning)
            return simulate_prepared(
                self._law,
                case.plant,
                case.scene.start,
                samples,
                disturbance=spec.disturbance,
                supervisor=spec.supervisor_of(case.plant),
                seed=spec.seed + number,
                clock=Clock() if self.real_time else None,
            )

    def _aligned(self, record: Record, samples: Array) -> Record:
        """Return what a robot measured at the times of the samples, up to where it stopped."""
        begin = record.desired[0, TIME]
        seen = record.desired[:, TIME] - begin  # the reference's time, which waits where messages are late
        rows = np.concatenate([[0], 1 + np.flatnonzero(np.diff(np.maximum.accumulate(seen)) > 0)])
        time = self.time - self.time[0]
        is_whole = seen[-1] > time[-1] - _MISSING * self.problem.spec.period
        count = len(time) if is_whole else np.searchsorted(time, seen[-1])

        def joined(values: Array) -> Array:
            return np.column_stack([np.interp(time[:count], seen[rows], each) for each in values[rows].T])

        q = joined(record.measured)
        pose = self.case.scene.robot.fkm(q)
        if self.problem.block.measured_by == "tracker":
            pose = self._tracked(record, rows, seen[rows], time[:count])
        held = rows[np.searchsorted(seen[rows], time[:count] + 1e-9, side="right") - 1]
        return replace(
            record,
            time=self.time[:count],
            q=q,
            measured=q,
            command=record.command[held],
            pose=pose,
            desired=samples[:count],
            disturbance=None,
            readings={
                name: signal._replace(values=joined(signal.values))
                for name, signal in record.readings.items()
                if name in WRENCH_READINGS
            },
        )

    def _tracked(self, record: Record, rows: NDArray[np.intp], seen: Array, time: Array) -> Array:
        """Return where a tracker saw the end effector at some times, from rows of a record seen at increasing times."""
        if learnt_motion.TRACKED_POSE not in record.readings:
            raise ShapeError(
                f"{self.problem.where}: learn.measured_by: the robot's record has no reading "
                f"'{learnt_motion.TRACKED_POSE}'; give encoders"
            )
        path = Points(seen, record.readings[learnt_motion.TRACKED_POSE].values[rows])
        return path.samples(np.clip(time - seen[0], 0.0, path.duration))[:, POSE]

    def _seen(self, record: Record, number: int) -> tuple[Array, Array]:
        """Return the error as sensors see it, against the motion that was asked for, and what repeats are judged by.

        The error has the shape (N, 6); with forces in task axes, and the deflection along theirs. Repeats are judged by
        it, or by the forces' errors, N, shape (N, axes): which of two is smaller a way of theirs would not tell.
        """
        block, count = self.problem.block, len(self.time)
        is_tracked, noise = block.measured_by == "tracker", np.zeros((count, 6))
        poses = record.pose[:count] if is_tracked else self.case.scene.robot.fkm(record.measured[:count])
        if is_tracked and self._runner is None:
            noise = np.random.default_rng([self.problem.spec.seed, 77, number]).standard_normal((count, 6))
            noise[:, :3] *= block.tracker.orientation_noise
            noise[:, 3:] *= block.tracker.position_noise
        desired = self.samples[:, POSE]
        if self._delay:
            late = np.maximum(self.time - block.sensor_delay, self.time[0])
            desired = self.case.scene.reference.samples(late)[:, POSE]
        error = learnt_motion.hand_error(desired, poses) - noise
        if self.forces is None:
            return error, error
        seen = self.forces.pressed(record)
        if number == 0:
            self._skip_approach(seen.first_touch)
        error = self.forces.planned(self.forces.turned(error, desired))
        return error + seen.deflection, seen.error

    def _skip_approach(self, first_touch: float) -> None:
        """Learn nothing of the way to the contact, on which the next repeat would be twice as fast."""
        lasts = float(self.time[-1] - self.time[0])
        if 2 * first_touch >= lasts:
            when = f"at {first_touch:.3g} s" if math.isfinite(first_touch) else "nothing"
            raise ShapeError(
                f"{self.problem.where}: the first run touched {when} of {lasts:.3g} s, and nothing is learnt before "
                "twice that time; begin nearer to what is touched, or let the motion begin later"
            )
        self._skip = max(self._skip, first_touch)
        self.weights = learnt_motion.start_weights(self.time - self.time[0], self._skip)
        self.notes.append(f"contact: nothing is learnt in the first {self._skip:.2g} s, on the way to it")

    def _sizes(self, error: Array, cutoff: float) -> tuple[float, float]:
        """Return the error below the cut-off and what of it is noise, m; of forces, N."""
        smooth = low_passed(self.time, error, cutoff)
        nyquist = 0.5 / self.problem.spec.period
        share = math.sqrt(cutoff / (nyquist - cutoff)) if cutoff < nyquist else 1.0
        if self.forces is not None:
            # where not all is learnt yet the frame comes back from its way to the contact
            counts = self.weights[:, 0] == 1.0
            return _norm(smooth[counts]), share * _norm((error - smooth)[counts])
        rough = self.weights * (error - smooth)
        size = learnt_motion.weighted_norm(self.weights * smooth)
        return size, share * learnt_motion.weighted_norm(rough)

    def _repeat(
        self,
        record: Record,
        error: Array,
        number: int,
        size: float,
        noise: float,
        cutoff: float,
        outcome: str,
    ) -> LearningRun:
        count = len(self.time)
        judged = self.time >= self.time[0] + 2 * self._skip
        true, force, to_unit = learnt_motion.hand_error(self.samples[:, POSE], record.pose[:count]), None, 1e3
        if self.forces is not None:
            true = self.forces.planned(self.forces.turned(true, self.samples[:, POSE]))
            force, to_unit = _norm(self.forces.errors(record)[judged]), 1.0
            error = self.forces.planned(error)
        true = true[judged]
        way, turn = np.linalg.norm(true[:, 3:], axis=1), np.linalg.norm(true[:, :3], axis=1)
        seen = np.linalg.norm(error[judged, 3:], axis=1)
        return LearningRun(
            number=number,
            position=1e3 * _rms(way),
            orientation=math.degrees(_rms(turn)),
            peak=1e3 * float(way.max()),
            seen=1e3 * _rms(seen),
            learnable=to_unit * size,
            noise=to_unit * noise,
            cutoff=cutoff,
            peak_command=float(np.abs(record.command).max()),
            outcome=outcome,
            force=force,
        )

    def _say_what_is_hidden(self, best: LearningRun) -> None:
        if self.problem.block.measured_by == "encoders" and best.position > _HIDDEN * best.seen:
            self.notes.append(
                f"encoders: they see {best.seen:.2g} of {best.position:.2g} mm; what sag, springs and filters behind "
                "them hide is not learnt (learn.measured_by: tracker)"
            )


def _text(problem: LearnProblem) -> str:
    """Return spec and block as YAML."""
    block = msgspec.to_builtins(problem.block, enc_hook=str)
    return yaml_text(problem.data | {"learn": {k: v for k, v in block.items() if v not in (None, {})}})


def _norm(errors: Array) -> float:
    """Return the root of the mean square of rows (N, k)."""
    return _rms(np.linalg.norm(errors, axis=1))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _outcome(size: float, best: float, noise: float) -> str:
    """Say what became of the error: growth is more than what noise of its size can make of the best one."""
    if size < best:
        return "accepted"
    return "grown" if size > _GROWN * best and size - best > noise else "flat"
