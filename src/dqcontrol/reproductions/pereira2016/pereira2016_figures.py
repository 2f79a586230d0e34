"""Figures of the published experiments beside those of their studies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dqcontrol.experiments.sampling_time import SamplingTime
from dqcontrol.experiments.study import Study
from dqcontrol.loop.record import Record
from dqcontrol.references.sample import TWIST
from dqcontrol.reproductions.pereira2016.verdicts.evidence import record_of
from dqcontrol.reproductions.pereira2016.verdicts.grid import grid_of
from dqcontrol.reproductions.printed import PublishedCell
from dqcontrol.reproductions.printed_comparison import NAMES
from dqcontrol.reproductions.reproduced import Draw
from dqcontrol.reproductions.results import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def study_figures(name: str, studies: Mapping[str, Study]) -> dict[str, Draw]:
    """Return what shows a reproduction's studies, by file name: App. D's surfaces, 5.9's painting."""
    if name == "light-painting":
        return {name: lambda: _painting(studies[name])}
    if name == "lqr-surface":
        return {label: lambda study=study: _surfaces(study) for label, study in studies.items()}
    return {}


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


def _painting(study: Study) -> Figure:
    from dqcontrol.films.light_painting import light_painting

    record = record_of(study.setting(), "LQR-DQ")
    return light_painting(record, lamp_on(record))


def lamp_on(record: Record) -> NDArray[np.bool_]:
    """Return at which samples the lamp is on, shape (N,): once the desired motion begins, before it the arm settles."""
    begun = np.linalg.norm(record.desired[:, TWIST], axis=1) > 0
    return np.maximum.accumulate(begun)


def _surfaces(study: Study) -> Figure:
    from dqcontrol.figures import surface

    metrics = {
        "Eff [rad s]": "joint_step.integral",
        "L.Vel [m]": "hand_speed.integral",
        "log₁₀ Err": "error.integral",
    }
    qs, rs, _ = grid_of(study.rows, "error.integral")
    heights = {title: grid_of(study.rows, key)[2] for title, key in metrics.items()}
    heights["log₁₀ Err"] = np.log10(heights["log₁₀ Err"])
    return surface(qs, rs, heights)


def _histogram(rows: Sequence[SamplingTime], period: float) -> Figure:
    from dqcontrol.figures import histogram

    return histogram({row.label: 1e3 * row.timing.periods for row in rows if row.timing.period == period})


def _parity(cells: Sequence[PublishedCell], ours: Results, suffixes: Sequence[str]) -> Figure:
    from dqcontrol.figures.parity import parity

    panels: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for cell in cells:
        for law in (cell.law + suffix for suffix in suffixes):
            where = (law, cell.set, cell.metric, cell.experiment)
            if len(ours.values(*where)):
                groups = panels.setdefault(NAMES[cell.metric], {})
                groups.setdefault(law, []).append((cell.mean, ours.mean(*where)))
    return parity(panels)
