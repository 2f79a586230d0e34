"""Print how near one explicit Euler step a sample comes to the printed errors of LQR-R8.

`python -m dqcontrol_theses.pereira2016.tools.euler`: each reading of "can be numerically solved backwards" [P16 3.44]
runs the spiral in physics at the nominal period, with the two sets of weights whose printed errors are a puzzle,
√(q/r) T > 1. Nothing is fitted to these; Err is over the printed one. Then the law, the same solved exactly and K at
the mean periods that Table 61 prints.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.experiments import measure, prepare
from dqcontrol.laws.parts import at_times, moving_target
from dqcontrol.tables import Column, Table
from dqcontrol_theses.pereira2016 import published_cells, published_spec
from dqcontrol_theses.pereira2016.own_periods import late_record, stretch
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PHYSICS, run_once
from dqcontrol_theses.pereira2016.published_numbers import published_mean
from dqcontrol_theses.variants import EulerLinearQuadraticR8

LAW, SETS = "LQR-R8", ("ln2", "best")
READINGS: dict[str, dict[str, Any]] = {
    "as in the tables": {},
    "weights and drift of the step's early end": {"late": 0},
    "the gain of the sample before": {"shift": -1},
    "the gain of the sample after": {"shift": 1},
    "no drift of the moving target in 3.44": {"drift": 0.0},
    "no feed-forward ξ": {"feed": 0.0},
    "horizon one sample shorter": {"cut": 1},
    "S = √(qr)": {"last": 1.0},
    "q × (1 + 1e-9)": {"weight": 1 + 1e-9},
    "q × 0.998": {"weight": 0.998},
    "q × 1.002": {"weight": 1.002},
    "three quarters of the assumed dry friction, f 0.785": {
        "plant": {"dry_friction": [1.5, 1.5, 0.75, 0.75, 0.225, 0.225, 0.225], "gravity_factor": 0.785}
    },
    "half the assumed dry friction, f 0.781": {
        "plant": {"dry_friction": [1, 1, 0.5, 0.5, 0.15, 0.15, 0.15], "gravity_factor": 0.781}
    },
    "twice the assumed dry friction, f 0.824": {
        "plant": {"dry_friction": [4, 4, 2, 2, 0.6, 0.6, 0.6], "gravity_factor": 0.824}
    },
    "no shaking, f as it is": {"plant": {"base_shaking": 0.0}},
    "states and commands at every tick, f as it is": {"plant": {"exchange_period": None}},
}


def solver(
    late: int = 1,
    shift: int = 0,
    drift: float = 1.0,
    feed: float = 1.0,
    cut: int = 0,
    last: float = 0.0,
    weight: float = 1.0,
):
    """Return what solves 3.44 as a reading has it, in place of the law's own."""

    def solve(self, weights, controls, final, times: Array, end, reference):
        count, period = len(times), float(times[1] - times[0])
        q = weight * at_times(weights, times)
        inverse = at_times((controls[0], np.linalg.inv(controls[1])), times)
        drifts, offsets = moving_target(reference, times.copy())
        p = last * np.sqrt(q[-1] @ np.linalg.inv(inverse[-1])) if last else final.copy()
        xi = np.zeros(8)
        out, out_xi = np.zeros((count, 8, 8)), np.zeros((count, 8))
        out[-1], out_xi[-1] = p, xi
        for k in range(count - 2 - cut, -1, -1):
            a, c, i = drift * drifts[k + late], offsets[k + late], k + late
            closed = a - inverse[i] @ p
            p, xi = (
                p + period * (p @ a + a.T @ p - p @ inverse[i] @ p + q[i]),
                xi + period * (closed.T @ xi + p @ c),
            )
            p = 0.5 * (p + p.T)  # its antisymmetric rounding would grow
            out[k], out_xi[k] = p, xi
        rows = np.clip(np.arange(count) + shift, 0, count - 1)
        return out[rows], feed * out_xi[rows]

    return solve


def ratios(reading: dict[str, Any], chosen: str) -> list[float]:
    """Return Err, ∫|u| and L.Vel of a reading over the printed ones."""
    solved = {key: value for key, value in reading.items() if key != "plant"}
    data = published_spec("spiral", PHYSICS)
    data["plant"] |= reading.get("plant", {})
    own = EulerLinearQuadraticR8.riccati_solution
    EulerLinearQuadraticR8.riccati_solution = solver(**solved)
    try:
        found = run_once(data, LAW, chosen).metrics
    finally:
        EulerLinearQuadraticR8.riccati_solution = own
    return [
        getattr(found, metric).integral / published_mean("spiral", LAW, chosen, metric)
        for metric in ("error", "control", "hand_speed")
    ]


def late_ratios(label: str, law: str) -> list[float]:
    """Return Err over the printed one for each of its sets, of a law of the spec at the printed period of a law."""
    setting = prepare(published_spec("spiral", PHYSICS))
    found = []
    for cell in published_cells("spiral"):
        if (cell.law, cell.metric) == (law, "error"):
            case = next(
                each for each in setting.cases if (each.names.law, each.names.set) == (label, cell.set)
            )
            record = late_record(setting, case, max(stretch(law, setting.spec.period), 1.0))
            criteria = measure(record, case.scene.robot, setting.spec.skip_initial, setting.spec.metrics_from)
            found.append(criteria.error.integral / cell.mean)
    return found


def main() -> None:
    """Run all readings and print them."""
    rows = []
    for label, reading in READINGS.items():
        each = [ratios(reading, chosen) for chosen in SETS]
        rows.append([label, *(value for one in each for value in one)])
    names = ("Err", "θ̇", "L.Vel")
    columns = [
        Column("3.44 solved with"),
        *(Column(f"{name}, {chosen}", "", ".3f") for chosen in SETS for name in names),
    ]
    title = "LQR-R8 over print, at the nominal period"
    print(Table(columns, rows, title))
    rows = [
        [label, *late_ratios(label, law)] for label, law in {LAW: LAW, f"{LAW} exact": LAW, "K": "K"}.items()
    ]
    columns = [Column("Law"), *(Column(f"Err, {chosen}", "", ".3f") for chosen in ("ln2²", "ln2", "best"))]
    print(Table(columns, rows, "At the mean periods that Table 61 prints, over print"))


if __name__ == "__main__":
    main()
