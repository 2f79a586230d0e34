"""[S17 5.2.3.2]: clamping that spares the motors of the robot."""

from __future__ import annotations

import numpy as np

from dqcontrol import algebra, figures
from dqcontrol.experiments import Combination
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop import Record, simulate_prepared
from dqcontrol.robots import Robot
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.judgement import ABOUT_THE_ROBOT, Judgement
from dqcontrol_theses.reproduced import Draw, Reproduced
from dqcontrol_theses.silva2017.goal_runs import until_good_enough
from dqcontrol_theses.silva2017.pictures import ghosted_strip, if_drawable
from dqcontrol_theses.silva2017.specs import OURS, S17, setting_of, spec_data, verdicts
from dqcontrol_theses.variants import TiringMotors

LIMITS = {
    "no clamping": CommandLimits(),
    "modified clamping": CommandLimits(position=ModifiedClamping()),
}

_SECOND_JOINT, _EXTENDED, _DRAWN = 4, 0.9, 20_000  # its frame; of the largest extension, sought so often
MOTORS = TiringMotors()  # in place of the spec's ideal joints


def reproduce(conditions: Conditions) -> Reproduced:
    """Run both laws without and with clamping on motors that give up."""
    study = conditions.run_study("clamping-robot", spec_data("clamping-robot"))
    setting = setting_of("clamping-robot")
    records = {case.names.law: _records(case, setting.spec.period) for case in setting.cases}
    robot, shown = setting.scene.robot, records[OURS]
    drawn: dict[str, Draw] = {
        "figure-5.11-lines": lambda: figures.superimposed(robot, shown),
        "figure-5.12": lambda: figures.compare_poses(shown),
        "figure-5.13": lambda: figures.compare_joints(
            shown, robot.limits, range(3, 8), _given_up(shown["no clamping"])
        ),
    }
    by_s17 = {label: until_good_enough(record) for label, record in records[S17].items()}
    return Reproduced(
        "silva2017/clamping-robot",
        [_table(records), verdicts("clamping-robot", _judge(robot, by_s17), _judge(robot, records[OURS]))],
        {"clamping-robot": study},
        drawn,
        files=if_drawable({"figure-5.11.png": ghosted_strip(robot, _with_and_without(shown), _times(shown))}),
    )


def _records(case: Combination, period: float) -> dict[str, Record]:
    scene = case.scene
    return {
        label: simulate_prepared(
            case.variant.law.prepare(scene.robot, scene.reference, period, limits),
            MOTORS,
            scene.start,
            scene.samples,
        )
        for label, limits in LIMITS.items()
    }


def _with_and_without(records: dict[str, Record]) -> dict[str, Record]:
    """Return the run with clamping first, which is drawn as it is."""
    return {label: records[label] for label in ("modified clamping", "no clamping")}


def _times(records: dict[str, Record]) -> list[float]:
    """Return the start, when the run without clamping ends or a quarter of the way, and the end, s."""
    free, clamped = records["no clamping"].duration, records["modified clamping"].duration
    return [0.0, min(free, 0.25 * clamped), clamped]


def _torques(record: Record) -> np.ndarray:
    return record.readings["motor_torque"].values.max(axis=0)


def _given_up(record: Record) -> tuple[float, float] | None:
    """Return the time from which a motor has given up to the end."""
    if not record.stopped.startswith("faulted"):
        return None
    return float(record.stopped.split()[2]), float(record.time[-1])


def _table(records: dict[str, dict[str, Record]]) -> Table:
    rows: list[list[tuple[Column, Cell]]] = [
        [
            (Column("Law"), law),
            (Column("Limits"), label),
            *(
                (Column(f"Joint {i}: largest torque", "N·m", ".3f"), float(torque))
                for i, torque in enumerate(_torques(record), 1)
            ),
            (Column("Ended by"), record.stopped),
            (Column("Least error", "", ".3g"), float(record.error.min())),
            (Column("Error at the end", "", ".3g"), float(record.error[-1])),
        ]
        for law, each_law in records.items()
        for label, record in each_law.items()
    ]
    title = f"S17 Figs 5.11–5.13; motors give up after a second above {MOTORS.torque} N·m, assumed"
    return Table.of(rows, title)


def _excess(robot: Robot, record: Record) -> np.ndarray:
    """Return by how much the joint that is farthest beyond its limit is so over time, rad; negative within them."""
    lower, upper = robot.limits.lower[3:], robot.limits.upper[3:]
    return np.maximum(lower - record.q[:, 3:], record.q[:, 3:] - upper).max(axis=1)


def _extension(robot: Robot, record: Record) -> np.ndarray:
    """Return the distance from the second joint to the hand over time, as a share of the largest possible."""

    def distance(q: np.ndarray) -> np.ndarray:
        frames = algebra.translation(robot.frames(q))
        return np.linalg.norm(frames[..., -1, :] - frames[..., _SECOND_JOINT, :], axis=-1)

    drawn = np.zeros((_DRAWN, robot.configuration_size))
    drawn[:, 3:] = np.random.default_rng(0).uniform(-np.pi, np.pi, (_DRAWN, robot.configuration_size - 3))
    return distance(record.q) / float(distance(drawn).max())


def _judge(robot: Robot, records: dict[str, Record]) -> dict[str, Judgement]:
    free, clamped = records["no clamping"], records["modified clamping"]
    torques = {label: _torques(record) for label, record in records.items()}
    pairs = [
        f"joint {i + 1} {torques['no clamping'][i]:.2f} N·m, {torques['modified clamping'][i]:.2f} with clamping"
        for i in (1, 2)
    ]
    beyond, kept = (_excess(robot, each) for each in (free, clamped))
    extension, most = _extension(robot, free), float(torques["no clamping"].max())
    both = (beyond > 0) & (extension > _EXTENDED)
    return {
        "robot-keeps-limits": Judgement(
            bool(kept.max() <= 1e-9 and beyond.max() > 0),
            f"{np.degrees(max(kept.max(), 0.0)):.0f}° beyond with clamping, {np.degrees(max(beyond.max(), 0.0)):.0f}° "
            "without",
        ),
        "stresses-motors": Judgement(
            None, f"largest torque {most:.2f} N·m, {MOTORS.torque} assumed to be too much", ABOUT_THE_ROBOT
        ),
        "violates-midway": Judgement(
            None,
            f"{np.degrees(max(beyond.max(), 0.0)):.0f}° beyond; extended to {100 * extension.max():.0f} % at most, "
            f"{'both at once' if both.any() else 'not at once'}",
            ABOUT_THE_ROBOT,
        ),
        "motor-stops-without-clamping": Judgement(
            None,
            f"{free.stopped}; error {free.error[-1]:.3f}. Largest torques: {'; '.join(pairs)}",
            ABOUT_THE_ROBOT,
        ),
        "clamping-spares-motors": Judgement(
            None, f"{clamped.stopped}, error {clamped.error[-1]:.3f}", ABOUT_THE_ROBOT
        ),
    }
