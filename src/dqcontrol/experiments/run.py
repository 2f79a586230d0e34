"""One run: a robot, a reference, a law and a plant, and what came of it."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import LimitWarning, ShapeError, ValueRangeError, as_array, naming
from dqcontrol.experiments.metrics import Metrics, evaluate
from dqcontrol.experiments.output import new_folder
from dqcontrol.experiments.reach import check_reach
from dqcontrol.experiments.spec import AnyLaw, AnyPlant, RobotSpec, Spec, read_spec, spec_text
from dqcontrol.loop import Record, save_record, simulate
from dqcontrol.loop.closed_loop import check_disturbed
from dqcontrol.loop.simulate import step_count
from dqcontrol.references import Reference
from dqcontrol.robots import SerialArm, load_robot

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Run:
    """What came of one run.

    Attributes
    ----------
    spec
        YAML text of the spec with all defaults, from which the run can be repeated.
    robot
        The arm.
    record
        All samples.
    settle
        Length of the start that the settled errors leave out, s.
    label
        Law and plant.
    """

    spec: str
    robot: SerialArm
    record: Record
    settle: float
    label: str

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
        """Poses of the hand, shape (N, 8), inertial frame."""
        return self.record.pose

    @property
    def desired(self) -> Array:
        """Desired poses, shape (N, 8), inertial frame."""
        return self.record.desired_pose

    @property
    def error(self) -> Array:
        """|vec8(1 − short(x*x_d))|, shape (N,). [P16 5.1]"""
        return self.record.error

    @cached_property
    def metrics(self) -> Metrics:
        """The numbers that judge the run."""
        return evaluate(self.record, self.robot.limits, settle=min(self.settle, self.record.duration))

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write ``spec.yaml``, ``record.mcap``, ``metrics.json``, ``report.html`` and the plots.

        Parameters
        ----------
        folder
            A new folder.
        force
            Replace it, if it holds an earlier run.

        Raises
        ------
        ExistsError
            If the folder exists (and is not an earlier run, with ``force``).
        """
        with new_folder(folder, force=force) as new:
            self.write(new)
        return Path(folder)

    def export(self, path: str | Path, *, force: bool = False) -> Path:
        """Write all signals to a ``.csv``, ``.parquet`` or ``.mat`` file; see `dqcontrol.loop.export_record`.

        Raises
        ------
        dqcontrol.Error
            If the suffix is unknown, the file exists (without ``force``), or a library is missing.
        """
        from dqcontrol.loop.export import export_record

        units = ["rad" if kind == "revolute" else "m" for kind in self.robot.joint_types]
        notes = {"spec": self.spec, "label": self.label}
        return export_record(
            self.record, path, joint_units=units, input_units=units, notes=notes, force=force
        )

    def write(self, folder: Path) -> None:
        """Write the files of `save` into an existing folder."""
        from dqcontrol.view import save_plots, write_report

        (folder / "spec.yaml").write_text(self.spec, encoding="utf-8")
        save_record(self.record, folder / "record.mcap", self.spec)
        (folder / "metrics.json").write_text(
            json.dumps(self.metrics.to_dict(), indent=2) + "\n", encoding="utf-8"
        )
        units = ["rad" if kind == "revolute" else "m" for kind in self.robot.joint_types]
        save_plots(self.record, folder, self.robot.limits, joint_units=units, input_units=units)
        write_report(folder, self.record, self.metrics, spec=self.spec, title=self.label)


@dataclass(frozen=True)
class Setting:
    """A spec made ready: what all its runs share."""

    spec: Spec
    folder: Path
    robot: SerialArm
    start: Array
    reference: Reference
    samples: Array


def prepare(source: str | Path | dict[str, Any]) -> Setting:
    """Load everything that a spec names and check that it fits together, before anything moves.

    Raises
    ------
    dqcontrol.Error
        If something is missing, malformed, does not fit or is out of reach.
    """
    spec, folder = read_spec(source)
    if isinstance(source, dict):
        return _prepare(spec, folder)
    with naming(str(source)):
        return _prepare(spec, folder)


def _prepare(spec: Spec, folder: Path) -> Setting:
    chosen = spec.robot if isinstance(spec.robot, RobotSpec) else RobotSpec(source=spec.robot)
    near = folder / chosen.source
    robot = load_robot(near if near.is_file() else chosen.source, chosen.base_link, chosen.tip_link)
    start = as_array("start", spec.start, (robot.configuration_size,))
    outside = (start < robot.limits.lower) | (start > robot.limits.upper)
    if outside.any():
        i = int(outside.argmax())
        raise ValueRangeError(
            f"start: {robot.joint_names[i]} is {start[i]:g}, outside its limits "
            f"{robot.limits.lower[i]:.4g} … {robot.limits.upper[i]:.4g}"
        )
    reference = spec.reference.build(robot.fkm(start), folder)
    samples = reference.samples(spec.period * np.arange(step_count(reference, spec.period, spec.duration)))
    if spec.settle > samples[-1, -1]:
        raise ValueRangeError(f"settle: must be ≤ the run's {samples[-1, -1]:g} s, got {spec.settle:g}")
    check_reach(robot, start, samples)
    for label, law in spec.law_by_label.items():
        with naming(f"law {label}"):
            law.prepare(robot, reference, spec.period, spec.limits)
    for label, plant in spec.plant_by_label.items():
        with naming(f"plant {label}"):
            live = plant.start(robot, start, spec.period, 1, spec.seed)
            if spec.disturbance is not None:
                check_disturbed(live)
    if spec.disturbance is not None:
        spec.disturbance.start(robot, spec.period, 1, spec.seed)
    return Setting(spec, folder, robot, start, reference, samples)


def run_one(
    setting: Setting,
    law_label: str,
    plant_label: str,
    *,
    interpreted: bool = False,
    progress: Progress | None = None,
) -> Run:
    """Execute one law on one plant of a prepared spec."""
    spec = setting.spec
    law, plant = spec.law_by_label[law_label], spec.plant_by_label[plant_label]
    record = simulate(
        setting.robot,
        setting.reference,
        law,
        plant,
        setting.start,
        spec.period,
        spec.duration,
        limits=spec.limits,
        stop=spec.stop,
        disturbance=spec.disturbance,
        seed=spec.seed,
        interpreted=interpreted,
        progress=progress,
    )
    text = spec_text(_single(spec, law, plant), setting.folder)
    done = Run(text, setting.robot, record, spec.settle, f"{law_label} · {plant_label}")
    if done.metrics.limit_margin < 0:
        warnings.warn(
            f"{done.label}: {done.metrics.limit_joint} went {-done.metrics.limit_margin:.3g} rad or m "
            "beyond its limits",
            LimitWarning,
            stacklevel=3,
        )
    return done


def _single(spec: Spec, law: AnyLaw, plant: AnyPlant) -> Spec:
    return msgspec.structs.replace(spec, law=law, laws=msgspec.UNSET, plant=plant, plants=msgspec.UNSET)


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
    dqcontrol.Error
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
        raise ShapeError("spec: has several laws or plants; use dqcontrol.run_study for it")
    (law,), (plant,) = setting.spec.law_by_label, setting.spec.plant_by_label
    return run_one(setting, law, plant, interpreted=interpreted, progress=progress)
