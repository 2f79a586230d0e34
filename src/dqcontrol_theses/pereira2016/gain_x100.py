"""The robust laws with a hundred times their printed gains, as the printed commands tell that they ran.

HIR and HIRT are printed with gains of 2 to 5 1/s, and with errors as small as those of K at 50 to 125 1/s. The printed
numbers alone say by how much the gains in use were larger: ∫|u| over ∫Err is a law's gain times what its Jacobian makes
of the error, and LQR-DQ has the same error and the same Jacobian, with a gain that is known. `printed_factors` finds
100 ± 2 in every set beside LQR-DQ, at both periods, and 93 to 102 in Tables 5.6 and 5.7, whose Err leaves out the first
tenth of the run and beside which LQR-DQ did not run: perhaps gains in percent, perhaps a hard-coded period of 0.01 s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.pereira2016.pereira2016_catalogue import published_spec
from dqcontrol_theses.pereira2016.published_numbers import published_cells, published_runs

FACTOR = 100.0
LAWS = ("HIR", "HIRT")
SUFFIX = f" × {FACTOR:g}"
_GAINS = ("orientation_gain", "translation_gain")
_KNOWN = "LQR-DQ"  # of the same error and the same Jacobian


def with_gain_x100(data: dict[str, Any], factor: float = FACTOR) -> dict[str, Any]:
    """Return a spec with the robust laws a second time, their gains times a factor, beside those as printed."""

    def scaled(laws: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        return laws | {
            law + SUFFIX: laws[law]
            | {key: _times(laws[law][key], factor) for key in _GAINS if key in laws[law]}
            for law in LAWS
            if law in laws
        }

    sets = {label: scaled(laws) for label, laws in data.get("parameter_sets", {}).items()}
    return data | {"laws": scaled(data["laws"])} | ({"parameter_sets": sets} if sets else {})


def _times(gain: Any, factor: float) -> Any:
    if isinstance(gain, dict):
        return gain | {"values": [factor * value for value in gain["values"]]}
    return factor * gain


def printed_factors() -> Table:
    """Return by which factor the printed numbers say that the printed gains of HIR and HIRT were larger in use.

    (∫|u|/∫Err) over that of LQR-DQ, times LQR-DQ's gain √(q/r), times the mean of 2/k_O over the run: k_O/2 is the rate
    at which these laws turn the hand, and nearly all of the error's norm is its orientation. For Section 5.5 LQR-DQ's
    number for a gain is that of the spiral of Section 5.7, and of ∫|u| that share counts which Err is of.
    """
    rows: list[list[tuple[Column, Cell]]] = [
        [
            (Column("Experiment"), name),
            (Column("Set"), label),
            (Column("Law"), law),
            (Column("∫|u|/∫Err", "", ".4g"), of_robust(law)),
            (Column("of LQR-DQ", "", ".4g"), of_known),
            (Column("√(q/r)", "1/s", ".4g"), known_gain),
            (Column("mean k_O/2 as printed", "1/s", ".4g"), 1 / inverse_gain),
            (Column("Factor", "", ".1f"), of_robust(law) / of_known * known_gain * inverse_gain),
        ]
        for name, label, of_robust, of_known, known_gain, inverse_gain in _pairs()
        for law in LAWS
    ]
    return Table.of(rows, "By what the gains of HIR and HIRT were larger in use, from printed numbers alone")


def _pairs() -> Iterator[tuple[Any, ...]]:
    """Yield each set that both a robust law and LQR-DQ are printed with."""
    series: dict[tuple[str, str, str], list[float]] = {}
    for run in published_runs("circle"):
        series.setdefault((run.law, run.set, run.metric), []).append(run.value)
    means = {key: float(np.mean(values)) for key, values in series.items()}
    circle = published_spec("circle")["laws"]
    inverse = _mean_inverse(
        circle["HIR"]["orientation_gain"], published_spec("circle")["reference"]["duration"]
    )
    for label in sorted(dict.fromkeys(where for law, where, _ in means if law == _KNOWN), key=len):

        def of_series(law: str, label: str = label) -> float:
            return means[law, label, "control"] / means[law, label, "error"]

        yield "circle, 20 ms", label, of_series, of_series(_KNOWN), math.sqrt(1000.0), inverse
    spec = published_spec("spiral")
    cells = {(cell.law, cell.set, cell.metric): cell.mean for cell in published_cells("spiral")}
    for label, laws in spec["parameter_sets"].items():

        def of_set(law: str, label: str = label) -> float:
            return cells[law, label, "control"] / cells[law, label, "error"]

        robust, gain = spec["laws"]["HIR"] | laws["HIR"], _known_gain(spec, label)
        inverse = _mean_inverse(robust["orientation_gain"], spec["reference"]["duration"])
        yield "spiral, 8 ms", label, of_set, of_set(_KNOWN), gain, inverse
    per_gain = [
        cells[_KNOWN, label, "control"] / cells[_KNOWN, label, "error"] / _known_gain(spec, label)
        for label in spec["parameter_sets"]
    ]
    yield from _pairs_of_five_gains(_known_gain(spec, "best"), float(np.mean(per_gain)))


def _known_gain(spec: dict[str, Any], label: str) -> float:
    law = spec["laws"][_KNOWN] | spec["parameter_sets"][label][_KNOWN]
    return math.sqrt(law["error_weight"] / law["control_weight"])


def _pairs_of_five_gains(known: float, per_gain: float) -> Iterator[tuple[Any, ...]]:
    """Yield the sets of Tables 5.6 and 5.7, beside what LQR-DQ would have with a gain."""
    spec = published_spec("h-infinity")
    cells = {(cell.law, cell.set, cell.metric): cell.mean for cell in published_cells("h-infinity")}
    share = 1 - spec["skip_initial"] / spec["reference"]["duration"]
    for label, laws in spec["parameter_sets"].items():

        def of_set(law: str, label: str = label) -> float:
            return share * cells[law, label, "control"] / cells[law, label, "error"]

        inverse = 2.0 / laws["HIR"]["orientation_gain"]["values"][-1]
        yield "spiral of 5.5, 8 ms", label, of_set, known * per_gain, known, inverse


def _mean_inverse(schedule: dict[str, list[float]], duration: float) -> float:
    """Return the mean of 2/k over a run, k linear between its values and constant after them."""
    times = np.linspace(0.0, duration, 10_001)
    return float(np.mean(2.0 / np.interp(times, schedule["times"], schedule["values"])))
