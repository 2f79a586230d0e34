"""Reproductions: published experiments run again, their tables beside the printed ones, verdicts on the claims."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dqcontrol.experiments.attenuation import attenuation_table
from dqcontrol.experiments.comparison import write_table
from dqcontrol.experiments.conduct import run_study
from dqcontrol.experiments.output import MARK, new_folder
from dqcontrol.experiments.published import second_fit
from dqcontrol.experiments.published.calibration import calibrate
from dqcontrol.experiments.published.catalogue import PLANT, SOURCE, Reproduction, reproduction
from dqcontrol.experiments.published.comparison import command_table, comparison_tables
from dqcontrol.experiments.published.figures import Draw, parity_figures, period_figures, study_figures
from dqcontrol.experiments.published.published_numbers import published_cells
from dqcontrol.experiments.published.published_specs import SERVO, published_spec
from dqcontrol.experiments.published.results import Results
from dqcontrol.experiments.published.verdicts import Evidence, judge, verdict_table
from dqcontrol.experiments.published.verdicts.h_infinity import attenuations
from dqcontrol.experiments.published.verdicts.sampling_time import PERIODS
from dqcontrol.experiments.published.when_to_use import when_to_use
from dqcontrol.experiments.sampling_time import sampling_table, sampling_times
from dqcontrol.experiments.study import Study
from dqcontrol.experiments.tables import Table

Progress = Callable[[str, float, int], None]  # what is run, how much of it is done, and how much it is in all

SAMPLES = 500  # of each real-time run
_SECOND = "second fit, no evidence"


@dataclass(frozen=True)
class Reproduced:
    """What a reproduction gave.

    Attributes
    ----------
    name
        With its source, as ``"pereira2016/spiral"``.
    tables
        Published | ours | ratio, and the verdicts.
    studies
        By the name of their spec.
    figures
        Beside those of the studies, by file name.
    plant
        What the Meka was, one of `published_specs.PLANTS`.
    """

    name: str
    tables: list[Table]
    studies: Mapping[str, Study] = field(default_factory=dict)
    figures: Mapping[str, Draw] = field(default_factory=dict)
    plant: str = PLANT

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write ``tables.md``, a CSV and a LaTeX file each table, figures, and a folder each study.

        Raises
        ------
        ExistsError
            If the folder exists (and holds no results, with ``force``).
        """
        with new_folder(folder, force=force) as new:
            command = f"# dqcontrol reproduce {self.name} --plant {self.plant}\n"
            (new / MARK).write_text(command, encoding="utf-8")
            text = "\n".join(table.markdown() for table in self.tables)
            (new / "tables.md").write_text(text, encoding="utf-8")
            for i, table in enumerate(self.tables, 1):
                write_table(table, new, f"table-{i}")
            for label, study in self.studies.items():
                study.save(new / label)
            for label, draw in self.figures.items():
                draw().savefig(new / f"{label}.png")
        return Path(folder)


def reproduce(
    name: str,
    *,
    plant: str = PLANT,
    jobs: int | None = None,
    samples: int = SAMPLES,
    progress: Progress | None = None,
) -> Reproduced:
    """Run a published experiment again and hold it against what was printed.

    Parameters
    ----------
    name
        As in `dqcontrol.experiments.published.catalogue.REPRODUCTIONS`, with or without ``pereira2016/``.
    plant
        What the Meka is: ``"servo"``, or ``"meka-physics"``, its compliant joints in MuJoCo.
    jobs
        Processes that work in parallel; as for `run_study`.
    samples
        Of each real-time run of ``sampling-time``; [P16] took 3000.
    progress
        Called with the name of what is run, how much of it is done, and how much it is in all.

    Raises
    ------
    UnknownNameError
        If there is no such experiment or plant.

    Examples
    --------
    >>> from dqcontrol.experiments.published import reproduce
    >>> reproduce("light-painting", jobs=1).studies["light-painting"].rows[0]["stopped"]
    'duration'
    """
    chosen, short = reproduction(name), name.removeprefix(f"{SOURCE}/")
    if short == "calibration":
        return Reproduced(f"{SOURCE}/{short}", [calibrate(plant)], plant=plant)
    if short == "sampling-time":
        return _in_real_time(chosen, plant, samples, progress)
    sources = {spec: published_spec(spec, plant) for spec in chosen.specs.values()}
    if chosen.scaled:
        sources |= {_scaled(spec): second_fit.scaled_spec(spec, plant) for spec in chosen.specs.values()}
    studies = {
        label: run_study(source, jobs=jobs, progress=_of(label, progress))
        for label, source in sources.items()
    }
    figures = study_figures(short, studies)
    if short == "light-painting":
        tables = [study.table() for study in studies.values()]
        return Reproduced(f"{SOURCE}/{short}", tables, studies, figures, plant)
    return _compared(short, chosen, plant, studies, figures)


def _compared(
    name: str, chosen: Reproduction, plant: str, studies: Mapping[str, Study], figures: Mapping[str, Draw]
) -> Reproduced:
    """Hold the studies against the printed tables and claims."""
    cells = published_cells(name)
    ours = _results(chosen, {experiment: studies[spec] for experiment, spec in chosen.specs.items()})
    settings = {where: studies[spec].setting() for where, spec in chosen.specs.items()}
    title = "" if plant == SERVO else plant
    tables = comparison_tables(cells, ours, title=title)
    second = None
    if chosen.scaled:
        scaled = {experiment: studies[_scaled(spec)] for experiment, spec in chosen.specs.items()}
        second = _results(chosen, scaled)
        fit = f"gains × {second_fit.FACTOR:g}: {_SECOND}"
        tables += comparison_tables(
            cells, second, suffix=second_fit.SUFFIX, title=f"{title} · {fit}" if title else fit
        )
    if any(cell.metric == "control" for cell in cells):
        tables.append(command_table(cells, ours, settings, title))
    if name == "h-infinity":
        tables.append(attenuation_table(attenuations()))
    evidence = Evidence(ours, settings, second, plant)
    if name == "spiral":
        tables.append(when_to_use(evidence))
    tables.append(verdict_table(name, judge(name, evidence), title))
    figures = {**figures, **parity_figures(cells, ours, second)}
    return Reproduced(f"{SOURCE}/{name}", tables, studies, figures, plant)


def _results(chosen: Reproduction, studies: Mapping[str, Study]) -> Results:
    rows = {experiment: study.rows for experiment, study in studies.items()}
    return Results(rows, chosen.error, chosen.control_unit)


def _in_real_time(chosen: Reproduction, plant: str, samples: int, progress: Progress | None) -> Reproduced:
    (spec,) = chosen.specs.values()
    source, periods = published_spec(spec, plant), list(PERIODS.values())
    rows = sampling_times(source, periods, samples, progress=_of(spec, progress))
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
        *comparison_tables(published_cells(spec), ours),
        sampling_table(rows, f"{samples} samples in real time on this machine"),
        verdict_table(spec, judge(spec, Evidence(ours, {}, plant=plant))),
    ]
    return Reproduced(f"{SOURCE}/{spec}", tables, figures=period_figures(rows), plant=plant)


def _scaled(spec: str) -> str:
    return f"{spec}-scaled"


def _of(label: str, progress: Progress | None) -> Callable[[float, int], None] | None:
    return None if progress is None else lambda done, total: progress(label, done, total)
