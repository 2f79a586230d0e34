"""Figures of the published experiments beside those of their studies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dqcontrol import figures, films
from dqcontrol.experiments import Study, execute
from dqcontrol.loop import Record
from dqcontrol.references import TWIST
from dqcontrol_theses.pereira2016.gain_x100 import LAWS, SUFFIX
from dqcontrol_theses.pereira2016.pereira2016_catalogue import EXACT
from dqcontrol_theses.pereira2016.published_numbers import FIXED, published_mean
from dqcontrol_theses.pereira2016.sampling_time import SamplingTime
from dqcontrol_theses.pereira2016.verdicts.evidence import Evidence, grid_of, record_of
from dqcontrol_theses.printed import PublishedCell
from dqcontrol_theses.reproduced import Draw
from dqcontrol_theses.results import NAMES, Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_SETS = {  # by experiment: spec, number of the printed figure, and the sets that get one each, that of the print first
    "circle": (("circle", "5.3", ("q=1 r=0.001", "q=10 r=0.01", "q=100 r=0.1", "q=1000 r=1")),),
    "spiral": (("spiral", "5.4", ("best", "ln2", "ln2²")),),
    "circle-and-square": (
        ("meka-circle", "C5", ("q=1000 r=1",)),
        ("meka-square", "C6", ("q=1000 r=1",)),
    ),
}
_SLOWEST, _FASTEST = "20 %", "100 %"


def study_figures(name: str, studies: Mapping[str, Study]) -> dict[str, Draw]:
    """Return what shows a reproduction's studies, by file name.

    As printed: one figure a set of gains with all laws (5.3, 5.4, and 5 and 6 of appendix C), pairs of the slowest and
    the fastest gains (5.2), surfaces (7 and 8 of appendix D).
    """
    if name == "lqr-surface":
        return {label: lambda study=study: _surfaces(study) for label, study in studies.items()}
    if name == "h-infinity":
        laws = [law + suffix for law in LAWS for suffix in ("", SUFFIX)]
        return {
            f"figure-5.2-{law.replace(' × ', '-times-')}": lambda law=law: _pair(studies[name], law)
            for law in laws
        }
    return {
        f"figure-{number}{_file_name(label) if i else ''}": lambda spec=spec, label=label: _one_set(
            name, studies[spec], label
        )
        for spec, number, labels in _SETS.get(name, ())
        for i, label in enumerate(labels)
    }


def _file_name(label: str) -> str:
    return "-" + label.replace("=", "").replace(" ", "-").replace("²", "-squared")


def _one_set(name: str, study: Study, label: str) -> Figure:
    """Draw all laws with one set of gains; the robust ones where they follow, and say where they do not."""
    setting, records = study.setting(), {}
    evidence = Evidence(Results({"": study.rows}), {}, reproduction=name)
    cases = [
        case
        for case in setting.cases
        if case.names.set in (label, FIXED) and not case.names.law.endswith(EXACT)
    ]
    robust = {
        case.names.law: case.names.set.replace(FIXED, "")
        for case in cases
        if case.names.law.removesuffix(SUFFIX) in LAWS
    }
    lost = {law: each for law, each in robust.items() if not evidence.followed(law, (each,))}
    for case in cases:
        if case.names.law not in lost:
            records[case.names.law] = execute(setting, case)
    named = ", ".join(_lost(name, evidence, *each) for each in lost.items())
    return figures.compare_criteria(
        records, "rad", f"Not drawn, as they did not follow: {named}." if lost else ""
    )


def _lost(name: str, evidence: Evidence, law: str, label: str) -> str:
    """Name a law that did not follow, and by how much."""
    printed = published_mean(name, law.removesuffix(SUFFIX), label)
    return f"{law} (Err {evidence.mean(law, label):.2g}, printed {printed:.2g})"


def _pair(study: Study, law: str) -> Figure:
    """Draw one law with a fifth of its gains and with all, side by side."""
    setting = study.setting()
    pair = {f"{law}, {each}": record_of(setting, law, each) for each in (_SLOWEST, _FASTEST)}
    return figures.criteria_side_by_side(pair, unit="rad")


def parity_figures(cells: Sequence[PublishedCell], ours: Results, suffixes: Sequence[str]) -> dict[str, Draw]:
    """Return all printed means against ours, by file name."""
    if not cells:
        return {}
    return {"published-and-ours": lambda: _parity(cells, ours, suffixes)}


def period_figures(rows: Sequence[SamplingTime]) -> dict[str, Draw]:
    """Return histograms of the measured periods by file name, as Figures 5.5 and 5.6."""
    return {
        f"periods-{1e3 * period:g}-ms": lambda period=period: _histogram(rows, period)
        for period in sorted({row.timing.period for row in rows})
    }


def painting_figures(records: Mapping[str, Record]) -> dict[str, Draw]:
    """Return all paintings side by side, as Figure 5.7, and one by one, by file name."""
    lit = {name: lamp_on(record) for name, record in records.items()}
    single: dict[str, Draw] = {
        name: lambda name=name: films.light_painting(records[name], lit[name]) for name in records
    }
    return {"light-painting": lambda: films.light_paintings(records, lit), **single}


def lamp_on(record: Record) -> NDArray[np.bool_]:
    """Return at which samples the lamp is on, shape (N,): once the desired motion begins, before it the arm settles."""
    begun = np.linalg.norm(record.desired[:, TWIST], axis=1) > 0
    return np.maximum.accumulate(begun)


def _surfaces(study: Study) -> Figure:
    metrics = {
        "Eff [rad s]": "joint_step.integral",
        "L.Vel [m]": "hand_speed.integral",
        "log₁₀ Err": "error.integral",
    }
    qs, rs, _ = grid_of(study.rows, "error.integral")
    heights = {title: grid_of(study.rows, key)[2] for title, key in metrics.items()}
    heights["log₁₀ Err"] = np.log10(heights["log₁₀ Err"])
    return figures.surface(qs, rs, heights)


def _histogram(rows: Sequence[SamplingTime], period: float) -> Figure:
    return figures.histogram(
        {row.label: 1e3 * row.timing.periods for row in rows if row.timing.period == period}
    )


def _parity(cells: Sequence[PublishedCell], ours: Results, suffixes: Sequence[str]) -> Figure:
    panels: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for cell in cells:
        for law in (cell.law + suffix for suffix in suffixes):
            where = (law, cell.set, cell.metric, cell.experiment)
            if len(ours.values(*where)):
                groups = panels.setdefault(NAMES[cell.metric], {})
                groups.setdefault(law, []).append((cell.mean, ours.mean(*where)))
    return figures.parity(panels)
