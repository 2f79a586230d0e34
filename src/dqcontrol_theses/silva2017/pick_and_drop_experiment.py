"""[S17 Fig. 5.1]: a cube into a basket, where cube, basket and base are seen by a camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dqcontrol import algebra, films
from dqcontrol.robots import load_robot
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.judgement import Judgement
from dqcontrol_theses.reproduced import Reproduced, Write
from dqcontrol_theses.silva2017.pick_and_drop_task import (
    BASKET,
    CAMERA,
    CUBE,
    HOLDS,
    PERIOD,
    ROBOT,
    PickAndDrop,
    pick_and_drop,
    regulate,
)
from dqcontrol_theses.silva2017.pictures import filmed, if_drawable
from dqcontrol_theses.silva2017.specs import GOOD_ENOUGH, OURS, S17, setting_of, verdicts

CLASSIC = "classic"
_LAWS = (S17, CLASSIC, OURS)
_LET_GO = 0.05  # m; from the hand to the cube at the end


def reproduce(conditions: Conditions) -> Reproduced:
    """Run it by set-points under each law, and once along a planned way; its pictures need OpenGL."""
    progress = conditions.of("pick-and-drop")
    laws = setting_of("comparison").spec.law_by_label
    if progress:
        progress(0, len(_LAWS) + 1)
    by_law: dict[str, PickAndDrop] = {}
    for number, label in enumerate(_LAWS, 1):
        by_law[label] = regulate(laws[label])
        if progress:
            progress(number, len(_LAWS) + 1)
    done = pick_and_drop()
    if progress:
        progress(len(_LAWS) + 1, len(_LAWS) + 1)
    printed = {
        "cube-into-basket": _judge([by_law[S17]]),
        "pose-is-regulated": _regulated(by_law, (S17, CLASSIC)),
    }
    ours = {
        "cube-into-basket": _judge([by_law[OURS], done]),
        "pose-is-regulated": _regulated(by_law, (OURS,)),
    }
    tables = [_set_points_table(by_law), _table(done), verdicts("pick-and-drop", printed, ours)]
    return Reproduced("silva2017/pick-and-drop", tables, files=_files(done, by_law))


def _held(done: PickAndDrop) -> list[float]:
    """Return the error norm at the end of each set-point; at those of the gripper, when it starts to move."""
    closed, opened = (event.time for event in done.errand.schedule)
    ends = np.cumsum(HOLDS)
    times = [ends[0], closed, ends[2], opened]
    last = len(done.record) - 1
    return [float(done.record.error[min(round(time / PERIOD) - 1, last)]) for time in times]


def _set_points_table(by_law: Mapping[str, PickAndDrop]) -> Table:
    places = ("above the cube", "at it", "above it", "above the basket")
    rows: list[list[tuple[Column, Cell]]] = [
        [
            (Column("Law"), label),
            *((Column(f"Error {where}", "", ".2g"), e) for where, e in zip(places, _held(done), strict=True)),
            (Column("Cube, greatest height", "mm", ".3g"), 1e3 * float(done.path[:, 2].max())),
            (Column("In the basket"), "yes" if done.is_in_basket else "no"),
            (Column("Beside its middle", "mm", ".3g"), 1e3 * _aside(done)),
            (Column("Ended by"), done.record.stopped),
        ]
        for label, done in by_law.items()
    ]
    title = (
        f"By set-points of {', '.join(f'{hold:g}' for hold in HOLDS)} s, S17's gains, cube, basket and base measured "
        f"by the camera at {CAMERA.rate:g} Hz all the time, in MuJoCo, seed 0"
    )
    return Table.of(rows, title)


def _regulated(by_law: Mapping[str, PickAndDrop], labels: Sequence[str]) -> Judgement:
    worst = {label: max(_held(by_law[label])) for label in labels}
    text = ", ".join(f"{label} {value:.2g}" for label, value in worst.items())
    return Judgement(max(worst.values()) < GOOD_ENOUGH, f"largest error at the end of a set-point: {text}")


def _apart(done: PickAndDrop) -> np.ndarray:
    """Return the distance between hand and cube, shape (N,), m."""
    return np.linalg.norm(done.path - algebra.translation(done.record.pose), axis=1)


def _aside(done: PickAndDrop) -> float:
    """Return how far beside the middle of the basket the cube rests, m."""
    return float(np.linalg.norm(done.path[-1, :2] - BASKET.position[:2]))


def _table(done: PickAndDrop) -> Table:
    record = done.record
    closed, opened = (event.time for event in done.errand.schedule)
    carried = (record.time > closed + 1.0) & (record.time < opened)
    seen = np.linalg.norm(done.seen[:, :2] - [CUBE.position[:2], BASKET.position[:2]], axis=1)
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
    return Table(
        columns,
        rows,
        "Our law along a planned way, cube and basket seen once; in MuJoCo, masses and friction are assumed",
    )


def _judge(runs: Sequence[PickAndDrop]) -> Judgement:
    """Judge runs by set-points, and our own along a planned way if there is a second."""
    said = [
        f"{'in' if done.is_in_basket else 'not in'} the basket, {1e3 * _aside(done):.0f} mm beside its middle"
        for done in runs
    ]
    return Judgement(
        all(done.is_in_basket and bool(_apart(done)[-1] > _LET_GO) for done in runs),
        "; along a planned way ".join(said) + "; one run each, seed 0",
    )


def _files(done: PickAndDrop, by_law: Mapping[str, PickAndDrop]) -> dict[str, Write]:
    """Return what draws the clip and the strip; nothing, and a warning, where there is no OpenGL."""
    end = float(done.record.time[-1])
    closed, opened = (event.time for event in done.errand.schedule)
    times = [0.0, closed, closed + 2.5, 0.5 * (closed + opened) + 1.0, opened, end]

    def set_points(path: Path) -> None:
        first, second = by_law[S17], by_law[CLASSIC]
        ends = np.cumsum(HOLDS).tolist()
        films.render_strip(
            load_robot(ROBOT),
            first.plant,
            first.record,
            path,
            [0.0, 4.0, ends[1] - 3.0, ends[2], ends[2] + 4.0, float(first.record.time[-1])],
            width=440,
            height=330,
            further=[(second.plant, second.record)],
            labels=(S17, CLASSIC),
            overwrite=True,
        )

    drawn = filmed("pick-and-drop", done.plant, done.record, times, speed=2)
    return if_drawable(drawn | {"pick-and-drop-set-points.png": set_points})
