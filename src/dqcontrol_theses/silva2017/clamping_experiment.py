"""[S17 5.2.3.1]: modified clamping on a goal that the limits forbid, and on the way back."""

from __future__ import annotations

import numpy as np

from dqcontrol import algebra, figures
from dqcontrol.arrays import Array
from dqcontrol.experiments import Combination
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop import Record, part_of, simulate_prepared
from dqcontrol.plants import Integrator
from dqcontrol.references import SetPoint, random_goals
from dqcontrol.robots import Robot
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.judgement import Judgement
from dqcontrol_theses.reproduced import Draw, Reproduced
from dqcontrol_theses.silva2017.specs import S17, setting_of, spec_data, verdicts
from dqcontrol_theses.variants import OriginalClamping

LIMITS: dict[str, CommandLimits] = {
    "no clamping": CommandLimits(),
    "modified clamping": CommandLimits(position=ModifiedClamping()),
    "original clamping": CommandLimits(position=OriginalClamping()),
}
_BACK = 60.0  # s, when the goal becomes the start again
_ARRIVED, _AT_LIMIT, _FREE = 1e-5, 1e-3, 1e-3
_SEED, _SECONDS, _NEAR = 2017, 60.0, 1e-3
_BEYOND, _FORBIDDEN = np.radians(150), 0.01  # of joints, and the least error of goals that are unreachable
_CLOSE = 0.02


def reproduce(conditions: Conditions, count: int = 100, beyond: int = 20) -> Reproduced:
    """Run without clamping, with the modified and with the original one; then random goals within limits and beyond."""
    study = conditions.run_study("clamping", spec_data("clamping"))
    setting = setting_of("clamping")
    robot, period = setting.scene.robot, setting.spec.period
    by_law = {
        case.names.law: {label: _record(case, period, limits) for label, limits in LIMITS.items()}
        for case in setting.cases
    }
    records = by_law[S17]
    nearest = closest_error(robot, records["no clamping"].desired_pose[0])
    unreachable = _unreachable(robot, beyond)
    judgements = [
        _judge(by_law[case.names.law], robot, nearest, _reached(case, period, count), count)
        | {"nearest-in-general": _judge_unreachable(case, period, unreachable)}
        for case in setting.cases
    ]
    joints = range(robot.configuration_size)
    drawn: dict[str, Draw] = {
        "figure-5.8": lambda: figures.superimposed(robot, _first_phase(records)),
        "figure-5.9": lambda: figures.compare_poses(records),
        "figure-5.10": lambda: figures.compare_joints(records, robot.limits, joints, (0.0, _BACK)),
    }
    tables = [_table(by_law, robot, nearest), verdicts("clamping", *judgements)]
    return Reproduced("silva2017/clamping", tables, {"clamping": study}, drawn)


def _record(case: Combination, period: float, limits: CommandLimits) -> Record:
    scene = case.scene
    law = case.variant.law.prepare(scene.robot, scene.reference, period, limits)
    back = SetPoint(scene.robot.fkm(scene.start)).samples(scene.samples[1:, -1])
    back[:, -1] += scene.samples[-1, -1]
    return simulate_prepared(law, Integrator(), scene.start, np.vstack([scene.samples, back]))


def closest_error(robot: Robot, goal: Array, starts: int = 40) -> float:
    """Return the least error norm to a goal that configurations within the limits have, by search."""
    from scipy.optimize import least_squares

    lower, upper = robot.limits.lower, robot.limits.upper

    def residual(q: Array) -> Array:
        error = algebra.short(algebra.multiply(algebra.conjugate(robot.fkm(q)), goal))
        return error - np.array([1.0, 0, 0, 0, 0, 0, 0, 0])

    draws = np.random.default_rng(_SEED).uniform(lower, upper, (starts, len(lower)))
    return min(float(np.linalg.norm(least_squares(residual, q, bounds=(lower, upper)).fun)) for q in draws)


def _reached(case: Combination, period: float, count: int) -> dict[str, int]:
    """Return how many of random goals within the limits are reached without and with clamping."""
    scene = case.scene
    goals = scene.robot.fkm(
        random_goals(scene.robot, scene.start, count, reach=0.0, lowest=-np.inf, seed=_SEED)
    )
    time = period * np.arange(int(_SECONDS / period))
    found = {}
    for label in ("no clamping", "modified clamping"):
        law = case.variant.law.prepare(scene.robot, None, period, LIMITS[label])
        runs = [
            simulate_prepared(law, Integrator(), scene.start, SetPoint(goal).samples(time)) for goal in goals
        ]
        found[label] = sum(bool(run.error[-1] < _NEAR) for run in runs)
    return found


def _unreachable(robot: Robot, count: int) -> list[tuple[Array, float]]:
    """Return poses that the limits forbid, of configurations within ±150°, and the least error to each."""
    rng, found = np.random.default_rng(_SEED), []
    while len(found) < count:
        pose = robot.fkm(rng.uniform(-_BEYOND, _BEYOND, robot.configuration_size))
        least = closest_error(robot, pose, starts=15)
        if least > _FORBIDDEN:
            found.append((pose, least))
    return found


def _judge_unreachable(case: Combination, period: float, goals: list[tuple[Array, float]]) -> Judgement:
    scene = case.scene
    time = period * np.arange(int(_SECONDS / period))
    law = case.variant.law.prepare(scene.robot, None, period, LIMITS["modified clamping"])
    over = [
        float(simulate_prepared(law, Integrator(), scene.start, SetPoint(goal).samples(time)).error[-1])
        / least
        for goal, least in goals
    ]
    near = sum(ratio < 1 + _CLOSE for ratio in over)
    return Judgement(
        near == len(over),
        f"{near} of {len(over)} goals within 2 %; last error over the least one, median {np.median(over):.2f}, "
        f"largest {max(over):.1f}",
    )


def _phases(record: Record) -> tuple[int, int]:
    """Return the last sample of the first phase and of the run."""
    return int(np.searchsorted(record.time, _BACK - 1e-6)), len(record) - 1


def _excess(record: Record, robot: Robot) -> float:
    return float(np.maximum(robot.limits.lower - record.q, record.q - robot.limits.upper).max())


def _blocked(record: Record, robot: Robot, k: int) -> list[int]:
    """Return the joints that are at a limit, or beyond it, at a sample."""
    margin = np.minimum(record.q[k] - robot.limits.lower, robot.limits.upper - record.q[k])
    return [int(i) for i in np.flatnonzero(margin < _AT_LIMIT)]


def _table(by_law: dict[str, dict[str, Record]], robot: Robot, nearest: float) -> Table:
    def row(law: str, limits: str, *cells: Cell) -> list[tuple[Column, Cell]]:
        columns = (
            Column("Error before the way back", "", ".3g"),
            Column("Largest excess", "rad", ".3g"),
            Column("At or beyond a limit then"),
            Column("Error at the end", "", ".3g"),
        )
        return [(Column("Law"), law), (Column("Limits"), limits), *zip(columns, cells, strict=True)]

    rows = []
    for law, records in by_law.items():
        for label, record in records.items():
            first, last = _phases(record)
            names = ", ".join(record.joint_names[i] for i in _blocked(record, robot, first)) or "none"
            excess = max(_excess(record, robot), 0.0)
            rows.append(row(law, label, float(record.error[first]), excess, names, float(record.error[last])))
    rows.append(row("", "nearest within the limits, by search", nearest, 0.0, "", None))
    return Table.of(rows, "S17 Figs 5.8–5.10; goal unreachable within ±90°, then the start again")


def _judge(
    records: dict[str, Record], robot: Robot, nearest: float, reached: dict[str, int], count: int
) -> dict[str, Judgement]:
    free, clamped = records["no clamping"], records["modified clamping"]
    first, last = _phases(clamped)
    ratio = float(clamped.error[first]) / nearest
    blocked, still = _blocked(clamped, robot, first), _blocked(clamped, robot, last)
    start = _blocked(clamped, robot, 0)  # the goal of the way back: joints that belong at a limit
    excess, arrived = _excess(free, robot), float(free.error[first])
    return {
        "converges-to-closest-pose": Judgement(
            abs(ratio - 1) < _CLOSE, f"{clamped.error[first]:.4f}, least possible {nearest:.4f}: {ratio:.3f}"
        ),
        "violates-without-clamping": Judgement(
            excess > 0.1 and arrived < _ARRIVED, f"{np.degrees(excess):.0f}° beyond, error {arrived:.1e}"
        ),
        "keeps-limits": Judgement(
            _excess(clamped, robot) <= 0, f"excess {max(_excess(clamped, robot), 0.0):.1e} rad"
        ),
        "returns-to-feasible-pose": Judgement(
            bool(clamped.error[last] < _ARRIVED), f"error {clamped.error[last]:.1e} at the end"
        ),
        "joints-become-free": Judgement(
            bool(blocked) and not set(still) - set(start),
            f"{len(blocked)} joints at a limit before the way back; at the end {len(still)}, "
            f"of which {len(set(still) & set(start))} start there",
        ),
        "clamping-keeps-convergence": Judgement(
            reached["modified clamping"] >= reached["no clamping"],
            f"{reached['no clamping']} of {count} reached without, {reached['modified clamping']} with clamping",
        ),
    }


def _first_phase(records: dict[str, Record]) -> dict[str, Record]:
    """Return the ways to the goal, with and without clamping."""
    return {
        label: part_of(records[label], 0, _phases(records[label])[0] + 1)
        for label in ("no clamping", "modified clamping")
    }
