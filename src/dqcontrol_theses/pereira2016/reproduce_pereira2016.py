"""Experiments of [P16] run again, their tables beside the printed ones, verdicts on the claims."""

from __future__ import annotations

from collections.abc import Mapping

from dqcontrol.experiments import Study, summary
from dqcontrol.measures import attenuation_table
from dqcontrol.tables import Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.judgement import verdict_table
from dqcontrol_theses.pereira2016.calibration import calibrate
from dqcontrol_theses.pereira2016.gain_x100 import SUFFIX, printed_factors, with_gain_x100
from dqcontrol_theses.pereira2016.operation_counts import operation_costs, operation_table
from dqcontrol_theses.pereira2016.own_periods import LateRun, late_laws, own_durations_table, run_late
from dqcontrol_theses.pereira2016.pereira2016_catalogue import (
    EXACT,
    EXPERIMENTS,
    PHYSICS,
    SERVO,
    SOURCE,
    Reproduction,
    drawing_specs,
    published_spec,
)
from dqcontrol_theses.pereira2016.pereira2016_figures import (
    painting_figures,
    parity_figures,
    period_figures,
    study_figures,
)
from dqcontrol_theses.pereira2016.published_numbers import claims, published_cells
from dqcontrol_theses.pereira2016.sampling_time import bare_loops, sampling_table, sampling_times
from dqcontrol_theses.pereira2016.tuned_comparison import reproduce_tuned_comparison
from dqcontrol_theses.pereira2016.verdicts import Evidence, judge
from dqcontrol_theses.pereira2016.verdicts.h_infinity_verdicts import attenuations
from dqcontrol_theses.pereira2016.verdicts.sampling_time_verdicts import PERIODS
from dqcontrol_theses.pereira2016.when_to_use import when_to_use
from dqcontrol_theses.pereira2016.writing import reproduce_writing
from dqcontrol_theses.reproduced import Draw, Reproduced
from dqcontrol_theses.results import Results, command_table, comparison_tables

_SHORT = "P16"
_BEYOND = {"tuned-comparison": reproduce_tuned_comparison, "writing": reproduce_writing}
_BESIDE = ("", EXACT, SUFFIX)  # of a law's label: as printed, and what stands beside it


def reproduce(name: str, conditions: Conditions) -> Reproduced:
    """Run one of `EXPERIMENTS` again and hold it against what was printed."""
    chosen, plant = EXPERIMENTS[name], conditions.plant
    if name == "calibration":
        return Reproduced(f"{SOURCE}/{name}", [calibrate(plant), printed_factors()], plant=plant)
    if name == "sampling-time":
        return _in_real_time(chosen, conditions)
    if name in _BEYOND:
        return _BEYOND[name](conditions)
    if name == "light-painting":
        return _paintings(conditions)
    sources = {spec: published_spec(spec, plant) for spec in chosen.specs.values()}
    if chosen.robust:
        sources = {spec: with_gain_x100(source) for spec, source in sources.items()}
    if conditions.repeats:
        for source in sources.values():
            source["repeats"] = min(source.get("repeats", 1), conditions.repeats)
    studies = {label: conditions.run_study(label, source) for label, source in sources.items()}
    figures = study_figures(name, studies)
    return _compared(name, chosen, conditions, studies, figures)


def _paintings(conditions: Conditions) -> Reproduced:
    """Paint each drawing once; their runs in one table, their pictures side by side and one by one."""
    specs = drawing_specs(conditions.plant)
    studies = {name: conditions.run_study(name, spec) for name, spec in specs.items()}
    runs = {name: next(iter(study.runs.values())) for name, study in studies.items()}
    table = summary(runs, f"Light paintings · {conditions.plant}")
    figures = painting_figures({name: run.record for name, run in runs.items()})
    return Reproduced(f"{SOURCE}/light-painting", [table], studies, figures, conditions.plant)


def _compared(
    name: str,
    chosen: Reproduction,
    conditions: Conditions,
    studies: Mapping[str, Study],
    figures: Mapping[str, Draw],
) -> Reproduced:
    """Hold the studies against the printed tables and claims."""
    cells, plant = published_cells(name), conditions.plant
    ours = _results(chosen, {experiment: studies[spec] for experiment, spec in chosen.specs.items()})
    settings = {where: studies[spec].setting() for where, spec in chosen.specs.items()}
    title = "" if plant == SERVO else plant
    tables, runs_by_law = [], {}
    for where, setting in settings.items():
        here = [cell for cell in cells if cell.experiment == where]
        in_physics = setting.cases[0].names.plant != SERVO
        tables += comparison_tables(here, ours, _SHORT, suffixes=_BESIDE, title=title if in_physics else "")
    if any(cell.metric == "control" for cell in cells):
        tables.append(command_table(cells, ours, settings, title, suffixes=_BESIDE))
        late = late_laws(cells, settings, chosen.specs) if plant == PHYSICS else []
        text = "".join(setting.text for setting in settings.values())
        runs = conditions.each("own periods", run_late, LateRun, late, text)
        runs_by_law = dict(zip(late, runs, strict=True))
        if table := own_durations_table(cells, ours, settings, title, runs_by_law):
            tables.append(table)
    if name == "h-infinity":
        tables.append(attenuation_table(attenuations()))
    criteria = {(law.law, law.set): run.criteria for law, run in runs_by_law.items()}
    evidence = Evidence(ours, settings, plant, name, criteria)
    if name == "spiral":
        tables.append(when_to_use(evidence))
    tables.append(_verdicts(name, evidence, title))
    figures = {**figures, **parity_figures(cells, ours, _BESIDE)}
    return Reproduced(f"{SOURCE}/{name}", tables, studies, figures, plant)


def _results(chosen: Reproduction, studies: Mapping[str, Study]) -> Results:
    rows = {experiment: study.rows for experiment, study in studies.items()}
    return Results(rows, chosen.error, chosen.control_unit)


def _verdicts(name: str, evidence: Evidence, title: str = "") -> Table:
    caption = " · ".join(filter(None, (f"Claims of {_SHORT}: {name}", title)))
    return verdict_table(claims(name), judge(name, evidence), _SHORT, caption)


def _in_real_time(chosen: Reproduction, conditions: Conditions) -> Reproduced:
    (spec,), plant, samples = chosen.specs.values(), conditions.plant, conditions.samples
    source, periods = published_spec(spec, plant), list(PERIODS.values())
    rows = [
        *bare_loops(periods, samples),
        *sampling_times(source, periods, samples, progress=conditions.of(spec)),
    ]
    sets = {period: label for label, period in PERIODS.items()}
    measured = [
        {
            "law": row.label.split(" · ")[0],
            "set": sets[row.timing.period],
            "stopped": "",
            "period": float(value),
        }
        for row in rows
        for value in row.timing.periods
    ]
    ours = Results({"": measured})
    tables = [
        *comparison_tables(published_cells(spec), ours, _SHORT),
        sampling_table(rows, f"{samples} samples in real time on this machine"),
        operation_table(operation_costs()),
        _verdicts(spec, Evidence(ours, {}, plant, spec)),
    ]
    return Reproduced(f"{SOURCE}/{spec}", tables, figures=period_figures(rows), plant=plant)
