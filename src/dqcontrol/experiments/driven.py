"""A robot that a person drives, from a spec or from the robot's name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.experiments.prepared_experiment import PreparedExperiment, prepare
from dqcontrol.experiments.real_time import StreamedRun
from dqcontrol.experiments.results_folder import SPEC_FILE
from dqcontrol.experiments.run import as_run
from dqcontrol.experiments.spec import read_data
from dqcontrol.files.input_file import read_text
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.loop.live import Live
from dqcontrol.loop.targets import Speeds
from dqcontrol.measures.task_range import with_range
from dqcontrol.recording import load_record
from dqcontrol.robots import Robot, TwoArms, describe, load_robot, most_dexterous

_ABOVE = 0.35  # of the reach: the end effector has room on all sides
_GAIN = 5.0  # 1/s

Ends = tuple[str | None, str | None]  # base and tip link


def prepare_live(source: str, speeds: Speeds | None = None, *, ends: Ends = (None, None)) -> Live:
    """Return a robot at rest to be driven, with the law, plant and supervisor of a spec.

    It always has a supervisor, with default parameters if the spec names none. A robot alone is simulated, on servos.

    Parameters
    ----------
    source
        Path of a spec of one run; or a robot's name or file.
    speeds
        As for `Live`.
    ends
        Base and tip link of the chain in a URDF file; a spec has its own.

    Raises
    ------
    Error
        If something is missing, malformed or does not fit, or the law needs a reference.
    """
    return live_of(prepare_driven(source, ends), speeds)


@contextmanager
def recorded_live(
    source: str,
    speeds: Speeds | None,
    folder: str | Path,
    *,
    ends: Ends = (None, None),
    force: bool = False,
) -> Iterator[Live]:
    """Give what `prepare_live` returns; what happens to it is recorded meanwhile, and in the end a run like any other.

    Parameters
    ----------
    source, speeds, ends
        As for `prepare_live`.
    folder
        A new folder.
    force
        Replace it, if it holds an earlier run.

    Raises
    ------
    dqcontrol.Error
        If something is wrong with them, or the recording cannot be written.
    """
    setting = prepare_driven(source, ends)
    (case,), live = setting.cases, live_of(setting, speeds)
    streamed = StreamedRun(folder, live.robot, live.spec, force=force)
    with streamed.record() as recording:
        live.recording = recording
        yield live
        recording.close(live.reason)
    streamed.complete(
        as_run(setting, case, 0, with_range(live.robot, load_record(streamed.path), case.variant.law))
    )


def prepare_driven(source: str | dict[str, Any], ends: Ends = (None, None)) -> PreparedExperiment:
    """Return the spec of one run, or that of a robot alone, made ready; see `prepare_live`."""
    if isinstance(source, dict):
        setting = prepare(source)
    elif is_spec(source):
        for field, link in zip(("base_link", "tip_link"), ends, strict=True):
            if link is not None:
                raise ShapeError(
                    f"{field}: '{source}' is a spec, which names its robot's links itself; got '{link}'"
                )
        setting = prepare(Path(source))
    else:
        setting = prepare(spec_of_robot(source, ends))
    setting.only_case("spec" if isinstance(source, dict) else source, "one is driven")
    return setting


def live_of(setting: PreparedExperiment, speeds: Speeds | None = None) -> Live:
    """Return the robot of a prepared spec of one run, at rest at its start."""
    (case,), spec = setting.cases, setting.spec
    live = Live(
        case.scene.robot,
        case.variant.law,
        case.plant,
        spec.period,
        start=case.scene.start,
        limits=case.limits,
        supervisor=spec.supervisor_of(case.plant),
        speeds=speeds,
        tasks=case.scene.tasks,
        seed=spec.seed,
    )
    live.spec = setting.single_text(case, 0)
    return live


def is_spec(source: str) -> bool:
    """Return whether a file says what a run needs, and not only what a robot is."""
    if Path(source).suffix not in (".yaml", ".yml") or not Path(source).is_file():
        return False
    data = parse_yaml(source, read_text(source))
    return isinstance(data, dict) and bool({"robot", "robots", "law", "laws", "plant"} & data.keys())


def driven_spec(source: str, ends: Ends = (None, None)) -> tuple[dict[str, Any], Path]:
    """Return the spec of a robot's name or file, of a spec's file or of a run's folder, and where its files lie.

    Raises
    ------
    Error
        If it is none of these.
    """
    path = Path(source)
    if (path / SPEC_FILE).is_file():
        path = path / SPEC_FILE
    if is_spec(str(path)):
        _, data, folder = read_data(path)
        return data, folder
    return spec_of_robot(source, ends), Path.cwd()


def spec_of_robot(robot: str, ends: Ends = (None, None)) -> dict[str, Any]:
    """Return a spec of a robot alone, on servos, at its most dexterous; of two arms the law drives the left one.

    A further task drives the right one.
    """
    loaded = load_robot(robot, *ends)
    own: dict[str, Any] = {"source": robot, "base_link": ends[0], "tip_link": ends[1]}
    beside: dict[str, Any] = {}
    if isinstance(loaded, TwoArms):
        own["task"] = "left"
        beside["tasks"] = [{"task": "right", "gain": _GAIN, "level": 1}]
    return {
        "name": "driven",
        "robot": own,
        "start": _start(loaded).tolist(),
        "period": 0.01,
        "reference": {"kind": "set-point", "duration": 1.0},
        "law": {"kind": "proportional-feedforward", "gain": _GAIN},
        "plant": {"kind": "servo"},
        **beside,
    }


def _start(robot: Robot) -> Array:
    """Return the most dexterous configuration that is well above the floor: of two arms, that of each."""
    if isinstance(robot, TwoArms):
        base = robot.base
        starts = [np.zeros(each.configuration_size) if each is base else _start(each) for each in robot.parts]
        return np.concatenate(starts)
    return most_dexterous(robot, _ABOVE * (describe(robot).reach or 1.0))
