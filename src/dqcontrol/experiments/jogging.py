"""A robot that keys drive, from a spec or from the robot's name."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.experiments.prepared_experiment import PreparedExperiment, prepare
from dqcontrol.experiments.run import as_run
from dqcontrol.experiments.streamed_run import StreamedRun
from dqcontrol.files.yaml_file import parse_yaml, read_text
from dqcontrol.loop.control import warm_up
from dqcontrol.loop.jog import Jog
from dqcontrol.loop.targets import Speeds
from dqcontrol.measures.task_range import with_range
from dqcontrol.plants.plant import command_mode, lagging_mode
from dqcontrol.recording import load_record
from dqcontrol.references.points_writer import PointsWriter
from dqcontrol.robots import Robot, load_robot
from dqcontrol.robots.robot import base_coordinates
from dqcontrol.supervisor import Supervisor

_STEPS = 100_000  # of noise drawn; then it repeats
_TRIES = 500

Ends = tuple[str | None, str | None]  # base and tip link


def prepare_jog(
    source: str,
    poses: PointsWriter | None = None,
    speeds: Speeds | None = None,
    *,
    ends: Ends = (None, None),
) -> Jog:
    """Return a robot at rest that keys drive, with the law, plant and supervisor of a spec.

    It always has a supervisor, with default parameters if the spec names none. A robot alone is simulated, on servos.

    Parameters
    ----------
    source
        Path of a spec of one run; or a robot's name or file.
    poses, speeds
        As for `Jog`.
    ends
        Base and tip link of the chain in a URDF file; a spec has its own.

    Raises
    ------
    Error
        If something is missing, malformed or does not fit, or the law needs a reference.
    """
    return _start(_setting(source, ends), poses, speeds)


@contextmanager
def recorded_jog(
    source: str,
    poses: PointsWriter | None,
    speeds: Speeds | None,
    folder: str | Path,
    *,
    ends: Ends = (None, None),
    force: bool = False,
) -> Iterator[Jog]:
    """Give what `prepare_jog` returns; what happens to it is recorded meanwhile, and in the end a run like any other.

    Parameters
    ----------
    source, poses, speeds, ends
        As for `prepare_jog`.
    folder
        A new folder.
    force
        Replace it, if it holds an earlier run.

    Raises
    ------
    dqcontrol.Error
        If something is wrong with them, or the recording cannot be written.
    """
    setting = _setting(source, ends)
    (case,), jog = setting.cases, _start(setting, poses, speeds)
    robot = case.scene.robot
    streamed = StreamedRun(folder, robot, setting.single_text(case, 0), force=force)
    with streamed.record() as recording:
        jog.recording = recording
        yield jog
        recording.close(jog.reason)
    streamed.complete(
        as_run(setting, case, 0, with_range(robot, load_record(streamed.path), case.variant.law))
    )


def _setting(source: str, ends: Ends) -> PreparedExperiment:
    if _is_spec(source):
        for field, link in zip(("base_link", "tip_link"), ends, strict=True):
            if link is not None:
                raise ShapeError(
                    f"{field}: '{source}' is a spec, which names its robot's links itself; got '{link}'"
                )
        setting = prepare(Path(source))
    else:
        setting = prepare(_spec_of(source, ends))
    setting.only_case(source, "keys drive one")
    return setting


def _start(setting: PreparedExperiment, poses: PointsWriter | None, speeds: Speeds | None) -> Jog:
    (case,), spec = setting.cases, setting.spec
    robot, start, plant = case.scene.robot, case.scene.start, case.plant
    law = case.variant.law.prepare(
        robot, None, spec.period, case.limits, lagging_mode(plant), lag=plant.lag(robot)
    )
    supervisor = spec.supervisor_of(plant) or Supervisor()
    guard = supervisor.prepare(robot, spec.period, command_mode(plant))
    warm_up(law, guard, start, case.scene.samples[0])
    live = plant.start(robot, start, spec.period, _STEPS, spec.seed)
    jog = Jog(law, guard, live, poses, speeds, _STEPS)
    jog.spec = setting.single_text(case, 0)
    return jog


def _is_spec(source: str) -> bool:
    """Return whether a file says what a run needs, and not only what a robot is."""
    if Path(source).suffix not in (".yaml", ".yml") or not Path(source).is_file():
        return False
    data = parse_yaml(source, read_text(source))
    return isinstance(data, dict) and bool({"robot", "robots", "law", "laws", "plant"} & data.keys())


def _spec_of(robot: str, ends: Ends) -> dict[str, Any]:
    start = most_dexterous(load_robot(robot, *ends))
    return {
        "name": "jog",
        "robot": {"source": robot, "base_link": ends[0], "tip_link": ends[1]},
        "start": start.tolist(),
        "period": 0.01,
        "reference": {"kind": "set-point", "duration": 1.0},
        "law": {"kind": "proportional-feedforward", "gain": 5.0},
        "plant": {"kind": "servo"},
    }


def most_dexterous(robot: Robot, lowest: float = -math.inf) -> Array:
    """Return the configuration of greatest manipulability among some hundred within the middle of the limits.

    Parameters
    ----------
    robot
        Whose.
    lowest
        Least height of the hand above the base frame's origin, m, with which no joint is below that. Where no
        configuration is so high, as of arms that hang, it does not count.

    Returns
    -------
    q : ndarray, shape (n,)
        rad or m; bases rest at the origin.
    """
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    tries = np.random.default_rng(0).uniform(0.2, 0.8, (_TRIES, len(lower)))
    tries = lower + tries * (upper - lower)
    tries[:, base_coordinates(robot)] = 0.0
    if math.isfinite(lowest):
        joints = translation(robot.frames(tries))[..., 2].min(axis=1)
        standing = (translation(robot.fkm(tries))[:, 2] >= lowest) & (joints >= 0)
        tries = tries[standing] if standing.any() else tries
    return tries[int(np.argmax(robot.manipulability(tries)))]
