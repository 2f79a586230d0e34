"""One run: a robot, a reference, a law and a plant, and what came of it."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace as replace_field

from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.errors import Error, ShapeError
from dqcontrol.experiments.check import LoopCheck, warn_unstable
from dqcontrol.experiments.failure_hints import warn_of_failures
from dqcontrol.experiments.prepared_experiment import Combination, PreparedExperiment, prepare
from dqcontrol.experiments.result_pages import ShownPage, replay, result_pages
from dqcontrol.experiments.results_folder import PARENT, new_folder
from dqcontrol.experiments.run_comparison import summary
from dqcontrol.experiments.spec import AnyLaw, AnyPlant, MetricsFrom, Spec, read_spec
from dqcontrol.experiments.spec.spec_files import write_spec
from dqcontrol.experiments.verdict import Judge, Verdict, verdict_of
from dqcontrol.files.long_array import row_by_row
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.loop import Clock, Record, Timing, simulate_prepared
from dqcontrol.loop.closed_loop import SampleSink
from dqcontrol.loop.supervision import BlackBox, Watch
from dqcontrol.measures.lyapunov import with_certificate
from dqcontrol.measures.metrics import Metrics, metrics_of
from dqcontrol.measures.run_numbers import run_numbers
from dqcontrol.measures.task_range import with_range
from dqcontrol.measures.task_result import TaskResult, task_result
from dqcontrol.plants.plant import command_mode
from dqcontrol.recording import export_record, save_record
from dqcontrol.references.sample import POSE
from dqcontrol.robots import Robot

Progress = Callable[[int, int], None]

_SAME = 1e-6  # of a pose's numbers: what is recorded is the reference's own, to rounding


@dataclass(frozen=True)
class Run:
    """What came of one run.

    Attributes
    ----------
    spec
        YAML text of the spec with all defaults, from which the run can be repeated.
    robot
        The arm or whole body.
    record
        All samples.
    skip_initial
        Length of the start that the settled errors leave out, s.
    label
        Law and plant.
    metrics_from
        Whether the metrics judge the true joint angles or those that the encoders gave.
    timing
        How a run in real time kept time.
    expected
        What was to be expected of its loops, if that was asked before it ran.
    low_pass
        Cut-off of the filter behind speeds and accelerations of an evaluated log, Hz; see `measures.evaluate`.
    """

    spec: str
    robot: Robot
    record: Record
    skip_initial: float
    label: str
    metrics_from: MetricsFrom = "true"
    timing: Timing | None = None
    expected: LoopCheck | None = None
    low_pass: float | None = None

    def __post_init__(self) -> None:
        lines = self.spec.splitlines()
        if not any(line.startswith(("name:", "evaluation:", "{")) for line in lines):
            raise ShapeError(
                "spec: must be the YAML text that repeats the run; without one use its record: "
                "measures.evaluate(record), recording.save_record(record, path), "
                'summary({"mine": record})'
            )

    def __repr__(self) -> str:
        return f"Run({self.label!r}, {len(self.record)} samples over {self.record.duration:g} s)"

    def __str__(self) -> str:
        """Return the metrics in a line of a table."""
        return str(summary({self.label: self}))

    @property
    def time(self) -> Array:
        """Times, shape (N,), s."""
        return self.record.time

    @property
    def q(self) -> Array:
        """True configurations, shape (N, n), rad or m."""
        return self.record.q

    @property
    def command(self) -> Array:
        """Inputs, shape (N, m), rad/s or m/s."""
        return self.record.command

    @property
    def pose(self) -> Array:
        """Poses of the end effector, shape (N, 8), inertial frame."""
        return self.record.pose

    @property
    def desired(self) -> Array:
        """Desired poses, shape (N, 8), inertial frame."""
        return self.record.desired_pose

    @property
    def error(self) -> Array:
        """|vec8(1 − short(x*x_d))|, shape (N,). [P16 5.1]"""
        return self.record.error

    @property
    def plant(self) -> AnyPlant | None:
        """What moved, as the spec has it; None of an evaluated log."""
        return None if self._parts is None else next(iter(self._parts.plant_by_label.values()))

    @property
    def law(self) -> AnyLaw | None:
        """What drove it, as the spec has it; None of an evaluated log."""
        return None if self._parts is None else next(iter(self._parts.law_by_label.values()))

    @cached_property
    def surroundings(self) -> Constraints | None:
        """What figures show around the robot: what its law kept clear of, and the world."""
        if self._parts is None or self.law is None:
            return None
        given, world = self.law.constraints, self._parts.surroundings
        return given if world is None else replace_field(given or Constraints(), world=world)

    @cached_property
    def _parts(self) -> Spec | None:
        data = parse_yaml("spec", self.spec)
        return None if "evaluation" in data else read_spec(data)[0]

    @cached_property
    def metrics(self) -> Metrics:
        """The numbers that judge the run."""
        return measure(
            self.record,
            self.robot,
            self.skip_initial,
            self.metrics_from,
            low_pass=self.low_pass,
            judge=self._judge,
        )

    @property
    def verdict(self) -> Verdict:
        """Whether it did what was asked and kept what it was to keep."""
        return verdict_of({**vars(self.metrics), "stopped": self.record.stopped})

    @property
    def _judge(self) -> Judge:
        spec = self._parts
        if spec is None:
            return Judge(self.robot)
        times = spec.period * np.arange(len(self.record), dtype=np.float64)
        start, folder = self.record.q[0], Path()  # as file names in the text are absolute
        tasks = spec.prepared_tasks(self.robot, start, folder, times)
        whole = self._whole(spec, folder)
        return Judge(self.robot, spec.variants[0].law, self.plant, spec, tasks, whole=whole)

    def _whole(self, spec: Spec, folder: Path) -> float:
        """Return the reference's duration, s; 0 where that takes a plan, its file is gone, or another was followed."""
        if not spec.may_cut:
            return 0.0
        try:
            reference = spec.reference.build(self.robot.fkm(self.record.q[0]), folder)
        except Error:  # a file that has been moved
            return 0.0
        wanted, last = reference.at(self.record.time[-1]).pose, self.record.desired[-1, POSE]
        return reference.duration if np.abs(wanted - last).max() < _SAME else 0.0

    @cached_property
    def task(self) -> TaskResult:
        """Whether it did what was asked."""
        record = as_measured(self.record, self.robot, self.metrics_from)
        skip_initial = min(self.skip_initial, record.duration)
        return task_result(record, law=self.law, skip_initial=skip_initial, robot=self.robot)

    def save(self, folder: str | Path, *, force: bool = False, figures: bool = True) -> Path:
        """Write ``spec.yaml``, ``record.mcap``, ``metrics.json`` and ``report.html``.

        Parameters
        ----------
        folder
            A new folder.
        force
            Replace it, if it holds an earlier run.
        figures
            False: no figures in the report, which take a second; ``dqcontrol figures`` draws them later.

        Raises
        ------
        ExistsError
            If the folder exists (and is not an earlier run, with ``force``).
        """
        with new_folder(folder, force=force) as new:
            self.write(new, figures=figures)
        return Path(folder)

    def export(self, path: str | Path, *, force: bool = False) -> Path:
        """Write all signals to a ``.csv``, ``.parquet`` or ``.mat`` file; see `dqcontrol.recording.export_record`.

        Raises
        ------
        Error
            If the suffix is unknown, the file exists (without ``force``), or a library is missing.
        """
        notes = {"spec": self.spec, "label": self.label}
        return export_record(self.record, path, **units_of(self.robot), notes=notes, force=force)

    def view(self, height: int = 480) -> ShownPage:
        """Return the run as a page that plays it: notebooks show it in a cell, ``view().html`` is the page itself.

        Parameters
        ----------
        height
            Of the cell, pixels.

        Raises
        ------
        MissingExtraError
            If viser is not installed.
        """
        return ShownPage(replay({self.label: self}), height)

    def _repr_mimebundle_(self, **_: object) -> dict[str, Any]:
        """Return what notebooks show: the metrics in a line, and the end effector's path."""
        image = base64.b64encode(result_pages().path_picture(self.record)).decode("ascii")
        html = f'<img alt="path" src="data:image/png;base64,{image}">'
        table = summary({self.label: self})
        return {"text/plain": repr(self.label), "text/markdown": f"{table.markdown()}\n{html}"}

    def write(self, folder: Path, outside: str = PARENT, *, figures: bool = True) -> None:
        """Write the files of `save` into an existing folder; ``outside`` leads from there out of all results."""
        self.write_data(folder)
        result_pages().write_run_report(self, folder, outside, figures=figures)

    def write_data(self, folder: Path) -> None:
        """Write the files of `save`, except report and plots, into an existing folder."""
        write_spec(self.spec, folder)
        save_record(self.record, folder / "record.mcap", self.spec)
        (folder / "metrics.json").write_text(
            json.dumps(self.metrics.to_dict(), indent=2) + "\n", encoding="utf-8"
        )


def units_of(robot: Robot) -> dict[str, list[str]]:
    """Return the units of coordinates and inputs as exports and figures take them."""
    kinds = {"joint_units": robot.joint_types, "input_units": robot.input_types}
    return {name: ["rad" if kind == "revolute" else "m" for kind in types] for name, types in kinds.items()}


def as_measured(record: Record, robot: Robot, metrics_from: MetricsFrom) -> Record:
    """Return a run as it is judged: with the true joint angles, or with those that the encoders gave."""
    if metrics_from == "true":
        return record
    return replace(record, q=record.measured, pose=row_by_row(robot.fkm, record.measured))


def measure(
    record: Record,
    robot: Robot,
    skip_initial: float,
    metrics_from: MetricsFrom = "true",
    *,
    low_pass: float | None = None,
    judge: Judge | None = None,
) -> Metrics:
    """Return the metrics of a run on a robot; of one that ended before it could settle, those of its last sample.

    ``judge`` gives its verdict; without it one that knows the robot alone.
    """
    limits, judge = robot.limits, judge or Judge(robot)
    # Commands that count from what is measured are no velocities of joints.
    if judge.plant is not None and command_mode(judge.plant) == "measured":
        limits = replace(limits, velocity=np.full_like(limits.velocity, np.inf))
    shown = as_measured(record, robot, metrics_from)
    skip_initial = min(skip_initial, record.duration)
    numbers = run_numbers(shown, limits, skip_initial, desired=judge.desired)
    task = task_result(shown, law=judge.law, skip_initial=skip_initial, robot=robot, numbers=numbers)
    metrics = metrics_of(shown, task, limits, skip_initial, low_pass=low_pass, numbers=numbers)
    verdict = judge.verdict(shown, metrics, task, skip_initial)
    return metrics.judged(verdict.words, verdict.failure)


def execute(
    setting: PreparedExperiment,
    case: Combination,
    repeat: int = 0,
    *,
    interpreted: bool = False,
    progress: Progress | None = None,
    clock: Clock | None = None,
    recording: Callable[[], SampleSink] | None = None,
    watch: Watch | None = None,
    black_box: BlackBox | None = None,
) -> Record:
    """Return the record of one trial of a prepared spec; with a clock in real time.

    Raises
    ------
    DivergedError
        If the very first command fails.
    """
    spec, scene = setting.spec, case.scene
    record = simulate_prepared(
        case.prepare_law(spec),
        case.plant,
        scene.start,
        scene.samples,
        stop=spec.stop,
        disturbance=spec.disturbance,
        supervisor=spec.supervisor_of(case.plant),
        seed=spec.seed + repeat,
        reference=scene.reference,
        lasts=spec.duration is None,
        interpreted=interpreted,
        progress=progress,
        clock=clock,
        recording=recording,
        watch=watch,
        black_box=black_box,
    )
    record = with_range(scene.robot, record, case.variant.law)
    if not spec.keeps_records:
        return record
    return with_certificate(scene.robot, record, case.variant.law, case.plant)


def as_run(setting: PreparedExperiment, case: Combination, repeat: int, record: Record) -> Run:
    """Return the record of a trial with the spec that repeats it."""
    text = setting.single_text(case, repeat)
    return Run(
        text, case.scene.robot, record, setting.spec.skip_initial, case.names.label, setting.spec.metrics_from
    )


def run(
    source: str | Path | dict[str, Any], *, interpreted: bool = False, progress: Progress | None = None
) -> Run:
    """Run a spec that has one law and one plant.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary; see `dqcontrol.experiments.Spec`.
    interpreted
        True: step in Python even if all parts are compiled; the result is the same to the last bit.
    progress
        Called with steps done and steps in all.

    Raises
    ------
    Error
        If something is missing, malformed, does not fit or is out of reach; before anything moves.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> result = dqc.run({
    ...     "name": "circle", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
    ...     "reference": {"kind": "circle", "radius": 0.07, "duration": 6},
    ...     "law": {"kind": "proportional-feedforward", "gain": 10}, "plant": {"kind": "integrator"},
    ... })
    >>> result.metrics.position.peak < 0.1  # mm
    True
    """
    setting = prepare(source)
    if not setting.spec.is_single:
        raise ShapeError("spec: describes several runs; use dqcontrol.run_study for it")
    (expected,) = warn_unstable(setting, stacklevel=2)
    (case,) = setting.cases
    record = execute(setting, case, interpreted=interpreted, progress=progress)
    done = replace(as_run(setting, case, 0, record), expected=expected)
    warn_of_failures([(case, [done.metrics.flat()])], stacklevel=2)
    return done
