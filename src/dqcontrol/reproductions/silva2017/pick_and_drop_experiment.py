"""[S17 Fig. 5.1]: a cube into a basket, where cube, basket and base are seen by a camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dqcontrol import algebra
from dqcontrol.measures.tables import Column, Table
from dqcontrol.reproductions.catalogue import Conditions
from dqcontrol.reproductions.judgement import Judgement
from dqcontrol.reproductions.reproduced import Reproduced, Write
from dqcontrol.reproductions.silva2017.pick_and_drop_task import (
    BASKET,
    CUBE,
    ROBOT,
    PickAndDrop,
    pick_and_drop,
)
from dqcontrol.reproductions.silva2017.pictures import if_drawable
from dqcontrol.reproductions.silva2017.specs import verdicts
from dqcontrol.robots import load_robot

_LET_GO = 0.05  # m; from the hand to the cube at the end


def reproduce(conditions: Conditions) -> Reproduced:
    """Run it once; its pictures need OpenGL."""
    progress = conditions.of("pick-and-drop")
    if progress:
        progress(0, 1)
    done = pick_and_drop()
    if progress:
        progress(1, 1)
    tables = [_table(done), verdicts("pick-and-drop", {"cube-into-basket": _judge(done)})]
    return Reproduced("silva2017/pick-and-drop", tables, files=_files(done))


def _apart(done: PickAndDrop) -> np.ndarray:
    """Return the distance between hand and cube, shape (N,), m."""
    return np.linalg.norm(done.path - algebra.translation(done.record.pose), axis=1)


def _aside(done: PickAndDrop) -> float:
    """Return how far beside the middle of the basket the cube rests, m."""
    return float(np.linalg.norm(done.path[-1, :2] - BASKET.position))


def _table(done: PickAndDrop) -> Table:
    record = done.record
    closed, opened = (event.time for event in done.errand.schedule)
    carried = (record.time > closed + 1.0) & (record.time < opened)
    seen = np.linalg.norm(done.seen[:, :2] - [CUBE.position, BASKET.position], axis=1)
    path = np.linalg.norm(np.diff(done.path, axis=0), axis=1).sum()
    rows = [
        ["Cube and basket in the camera's frame, off by at most", 1e3 * float(seen.max()), "mm"],
        ["Cube in the hand, farthest from its middle", 1e3 * float(_apart(done)[carried].max()), "mm"],
        ["Way of the cube", float(path), "m"],
        ["Hand from its desired pose, RMS", 1e3 * float(np.sqrt(np.mean(record.position_error**2))), "mm"],
        ["Cube beside the middle of the basket at the end", 1e3 * _aside(done), "mm"],
        ["Hand from the cube at the end", 1e3 * float(_apart(done)[-1]), "mm"],
        ["Time", record.duration, "s"],
    ]
    columns = [Column("What"), Column("Ours", "", ".3g"), Column("Unit")]
    return Table(columns, rows, "S17 Fig. 5.1, in MuJoCo; masses and friction are assumed")


def _judge(done: PickAndDrop) -> Judgement:
    where = "in" if done.is_in_basket else "not in"
    return Judgement(
        done.is_in_basket and bool(_apart(done)[-1] > _LET_GO),
        f"{where} the basket, {1e3 * _aside(done):.0f} mm beside its middle; one run, seed 0",
    )


def _files(done: PickAndDrop) -> dict[str, Write]:
    """Return what draws the clip and the strip; nothing, and a warning, where there is no OpenGL."""
    from dqcontrol.films.clip import render_clip, render_strip

    robot, end = load_robot(ROBOT), float(done.record.time[-1])
    closed, opened = (event.time for event in done.errand.schedule)
    times = [0.0, closed, closed + 2.5, 0.5 * (closed + opened) + 1.0, opened, end]

    def clip(path: Path) -> None:
        render_clip(
            robot, done.plant, done.record, path, speed=2, rate=12.5, width=480, height=360, overwrite=True
        )

    def strip(path: Path) -> None:
        render_strip(robot, done.plant, done.record, path, times, width=440, height=330, overwrite=True)

    return if_drawable({"pick-and-drop.webp": clip, "pick-and-drop.png": strip})
