"""[S17 6]: what the control period does to the feedback linearising law."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from msgspec.structs import replace

from dqcontrol import figures
from dqcontrol.experiments import PreparedExperiment
from dqcontrol.laws import FeedbackLinearization
from dqcontrol.loop import Record, simulate_prepared
from dqcontrol.measures import certificate
from dqcontrol.plants import Integrator
from dqcontrol.references import SetPoint
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.reproduced import Draw, Reproduced
from dqcontrol_theses.silva2017.goal_runs import RaceOutcome
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
    named = {f"T = {1e3 * period:g} ms": record for period, record in records.items()}
    drawn: dict[str, Draw] = {"periods": lambda: figures.compare_errors(named)}
    tables = [_table(settings, records, law), _limit_table(settings[PERIODS[0]], law)]
    return Reproduced("silva2017/discretisation", tables, {"discretisation": study}, drawn)


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
    def row(period: float, record: Record) -> list[tuple[Column, Cell]]:
        found = certificate(settings[period].scene.robot, record, law)
        each = RaceOutcome.of(record, period)
        return [
            (Column("T", "ms", ".4g"), 1e3 * period),
            (Column("Settling", "s", ".4g"), each.settling * period),
            (Column("Iterations", "", ".4g"), each.settling),
            (Column("Largest rise of V/V₀ a sample", "", ".2e"), found.largest_rise),
            (Column("First command |u_f|", "rad/s", ".3g"), each.first),
            (Column("Over T", "rad/s²", ".3g"), each.first / period),
            (Column("Effort", "rad/√s", ".3g"), each.effort),
            (Column("Overshoot", "%", ".3g"), 100 * each.overshoot),
            (Column("Error at the end", "", ".1e"), each.final),
        ]

    title = f"S17 chapter 6: effect of the period; settled below {GOOD_ENOUGH}"
    return Table.of((row(*each) for each in records.items()), title)


def _limit_table(setting: PreparedExperiment, law: FeedbackLinearization) -> Table:
    """Return whether the loop is stable just below and above the largest period, from a goal nearby."""
    scene, limit = setting.scene, largest_period(law)
    law = replace(law, null_space=None)  # whose own motion is not what is tried here
    inputs = np.zeros(scene.robot.input_size)
    inputs[0] = _NEAR
    goal = SetPoint(scene.robot.fkm(scene.robot.integrate(scene.start, inputs, 1.0)))

    def row(share: float) -> list[tuple[Column, Cell]]:
        period = share * limit
        samples = goal.samples(period * np.arange(_STEPS))
        record = simulate_prepared(law.prepare(scene.robot, None, period), Integrator(), scene.start, samples)
        error, half = record.error, len(record) // 2
        return [
            (Column("T over the limit", "", ".2f"), share),
            (Column("T", "s", ".3f"), period),
            (Column("Largest error of the first 20 samples", "", ".1e"), float(error[:20].max())),
            (Column("Of the second half", "", ".1e"), float(error[half:].max())),
            (Column("Ended by"), record.stopped),
        ]

    title = f"Stability limit (k̄/4) T² = 4 − 2 k_v T: T = {limit:.3f} s; a goal 1 mm ahead, {_STEPS} samples"
    return Table.of(map(row, _SHARES), title)
