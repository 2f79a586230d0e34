"""[S17 6]: what the control period does to the feedback linearising law."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from msgspec.structs import replace

from dqcontrol.experiments import PreparedExperiment
from dqcontrol.laws import FeedbackLinearization
from dqcontrol.loop import Record, simulate_prepared
from dqcontrol.measures import certificate
from dqcontrol.plants import Integrator
from dqcontrol.references import SetPoint
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.reproduced import Draw, Reproduced
from dqcontrol_theses.silva2017.race import RaceOutcome
from dqcontrol_theses.silva2017.specs import GOOD_ENOUGH, setting_of, spec_data

PERIODS = (0.0125, 0.025, 0.05, 0.1, 0.2, 0.4)  # s
_NEAR = 1e-3  # m: how far the goal is where the linear limit is tried
_SHARES = (0.95, 1.05)  # of the largest stable period
_STEPS = 400


def reproduce(conditions: Conditions) -> Reproduced:
    """Run the comparison's law with several periods, and near its stability limit."""
    study = conditions.run_study("discretisation", spec_data("discretisation"))
    settings = {period: setting_of("discretisation", period=period) for period in PERIODS}
    records = {period: _record(setting) for period, setting in settings.items()}
    law = cast(FeedbackLinearization, settings[PERIODS[0]].cases[0].variant.law)
    figures: dict[str, Draw] = {"periods": lambda: _errors(records)}
    tables = [_table(settings, records, law), _limit_table(settings[PERIODS[0]], law)]
    return Reproduced("silva2017/discretisation", tables, {"discretisation": study}, figures)


def largest_period(law: FeedbackLinearization) -> float:
    """Return the largest stable period of the linear error dynamics, s: k_v T < 2 and (k̄/4) T² < 4 − 2 k_v T."""
    a, b = 0.25 * law.stiffness, 2 * law.damping
    return min(2 / law.damping, (-b + math.sqrt(b * b + 16 * a)) / (2 * a))


def _record(setting: PreparedExperiment) -> Record:
    (case,) = setting.cases
    return simulate_prepared(
        case.prepare_law(setting.spec), Integrator(), case.scene.start, case.scene.samples
    )


def _table(
    settings: dict[float, PreparedExperiment], records: dict[float, Record], law: FeedbackLinearization
) -> Table:
    rows: list[list[Cell]] = []
    for period, record in records.items():
        robot = settings[period].scene.robot
        found, each = certificate(robot, record, law), RaceOutcome.of(record, period)
        rows.append(
            [
                1e3 * period,
                each.settling * period,
                each.settling,
                found.largest_rise,
                each.first,
                each.first / period,
                each.effort,
                100 * each.overshoot,
                each.final,
            ]
        )
    columns = [
        Column("T", "ms", ".4g"),
        Column("Settling", "s", ".4g"),
        Column("Iterations", "", ".4g"),
        Column("Largest rise of V/V₀ a sample", "", ".2e"),
        Column("First command |u_f|", "rad/s", ".3g"),
        Column("Over T", "rad/s²", ".3g"),
        Column("Effort", "rad/√s", ".3g"),
        Column("Overshoot", "%", ".3g"),
        Column("Error at the end", "", ".1e"),
    ]
    return Table(columns, rows, f"S17 chapter 6: effect of the period; settled below {GOOD_ENOUGH}")


def _limit_table(setting: PreparedExperiment, law: FeedbackLinearization) -> Table:
    """Return whether the loop is stable just below and above the largest period, from a goal nearby."""
    scene, limit = setting.scene, largest_period(law)
    law = replace(law, null_space=None)  # whose own motion is not what is tried here
    inputs = np.zeros(scene.robot.input_size)
    inputs[0] = _NEAR
    goal = SetPoint(scene.robot.fkm(scene.robot.integrate(scene.start, inputs, 1.0)))
    rows: list[list[Cell]] = []
    for share in _SHARES:
        period = share * limit
        samples = goal.samples(period * np.arange(_STEPS))
        record = simulate_prepared(law.prepare(scene.robot, None, period), Integrator(), scene.start, samples)
        error = record.error
        half = len(error) // 2
        rows.append([share, period, float(error[:20].max()), float(error[half:].max()), record.stopped])
    columns = [
        Column("T over the limit", "", ".2f"),
        Column("T", "s", ".3f"),
        Column("Largest error of the first 20 samples", "", ".1e"),
        Column("Of the second half", "", ".1e"),
        Column("Ended by"),
    ]
    title = f"Stability limit (k̄/4) T² = 4 − 2 k_v T: T = {limit:.3f} s; a goal 1 mm ahead, {_STEPS} samples"
    return Table(columns, rows, title)


def _errors(records: dict[float, Record]):
    from dqcontrol.figures import compare_errors

    return compare_errors({f"T = {1e3 * period:g} ms": record for period, record in records.items()})
