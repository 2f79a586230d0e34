"""A motion of the joints as files that run: for law ``joint-motion``, and the end effector's poses beside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.algebra import rotation, translation
from dqcontrol.arrays import Array
from dqcontrol.files.plain_data import yaml_text
from dqcontrol.references.points_file import POSITION, QUATERNION
from dqcontrol.robots import Robot

MOTION, HAND = "motion.csv", "hand.csv"

_HAND_STEP = 0.02  # s between the poses of the end effector's reference


def write_joint_motion(
    spec: Path,
    robot: Robot,
    time: Array,
    positions: Array,
    start: Array,
    plant: dict[str, Any],
    note: str,
    gain: float = 0.0,
    more: Mapping[str, Any] | None = None,
) -> None:
    """Write a spec, and beside it the joint positions and the poses of the end effector that it names.

    Parameters
    ----------
    spec
        The file; its name is that of the experiment.
    robot
        An arm with an origin, or one that comes with dqcontrol.
    time, positions
        Shape (N,), s, regular, from 0; (N, n), rad or m.
    start
        Configuration, shape (n,).
    plant
        As the spec says it.
    note
        First line of the spec.
    gain
        Of the law, 1/s.
    more
        Further keys of the spec.
    """
    period, folder = float(time[1] - time[0]), spec.parent
    _write_table(folder / MOTION, ["time", *robot.joint_names], np.column_stack([time, positions]))
    step = max(round(_HAND_STEP / period), 1)
    rows = np.append(np.arange(0, len(time) - 1, step), len(time) - 1)
    poses = robot.fkm(positions[rows])
    hand = np.column_stack([time[rows], translation(poses), rotation(poses)])
    _write_table(folder / HAND, ["time", *POSITION, *QUATERNION], hand)
    source, base_link, tip_link = robot.origin or (robot.name, None, None)
    ends = {key: value for key, value in (("base_link", base_link), ("tip_link", tip_link)) if value}
    data = {
        "name": spec.stem,
        "robot": {"source": source} | ends if ends else source,
        "start": [round(float(value), 9) for value in start],
        "period": round(period, 9),
        "reference": {"kind": "points", "file": HAND},
        "law": {"kind": "joint-motion", "file": MOTION} | ({"gain": gain} if gain else {}),
        "plant": plant,
        **(more or {}),
    }
    text = yaml_text(data)
    spec.write_text(f"# {note}\n{text}", encoding="utf-8")


def _write_table(path: Path, names: list[str], rows: Array) -> None:
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
