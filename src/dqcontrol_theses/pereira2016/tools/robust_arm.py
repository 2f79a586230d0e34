"""Search for an arm that bears HIR with a hundred times its printed gains.

`python -m dqcontrol_theses.pereira2016.tools.robust_arm [COUNT]`. The printed commands tell that HIR and HIRT ran with
these gains, and the arm of the reproductions shakes with them. Friction, springs, damping and slew limits of the
joints, and the rate at which the arm exchanges states and commands, are drawn at random about those of the
reproductions; each draw runs HIR on three published cells, and K on one beside them.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dqcontrol.files import read_yaml
from dqcontrol.loop import has_failed
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.pereira2016 import published_spec
from dqcontrol_theses.pereira2016.gain_x100 import SUFFIX, with_gain_x100
from dqcontrol_theses.pereira2016.pereira2016_catalogue import MEKA_CONTROLLERS, run_once
from dqcontrol_theses.pereira2016.published_numbers import FIXED, published_mean

SEED, COUNT, SHOWN = 17, 40, 8
CELLS = (
    ("h-infinity", "HIR", "100 %"),
    ("spiral", "HIR", "best"),
    ("circle", "HIR", FIXED),
    ("spiral", "K", "best"),
)
# Factors on what the arm of the reproductions has, from and to; drawn evenly on a logarithmic scale.
RANGES = {
    "dry friction": (0.5, 16.0),
    "viscous friction": (0.5, 16.0),
    "springs": (0.5, 8.0),
    "damping of the position loops": (0.5, 8.0),
    "slew limits": (0.25, 4.0),
}
EXCHANGES = (None, 0.005, 0.01, 0.02)  # s


def main() -> None:
    """Print the draws that come nearest."""
    warnings.simplefilter("ignore")
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    rng, rows = np.random.default_rng(SEED), []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(count + 1):
            factors = {
                name: float(np.exp(rng.uniform(np.log(low), np.log(high)))) if k else 1.0
                for name, (low, high) in RANGES.items()
            }
            exchange = EXCHANGES[rng.integers(len(EXCHANGES))] if k else 0.01
            plant = arm(factors, exchange, Path(folder) / f"{k}.yaml")
            rows.append([*factors.values(), 1e3 * (exchange or 0.001), *ratios(plant)])
    first, drawn = rows[0], sorted(rows[1:], key=lambda row: worst(row, slice(-8, -2)))
    columns = [
        *(Column(f"{name} ×", "", ".2g") for name in RANGES),
        Column("exchange", "ms", "g"),
        *(
            Column(f"{law}{SUFFIX if law == 'HIR' else ''} {spec} {label}: {metric}", "", ".2f")
            for spec, law, label in CELLS
            for metric in ("Err", "L.Vel")
        ),
    ]
    title = f"The arm of the reproductions, and the best {SHOWN} of {count} others, seed {SEED}; ours over printed"
    print(Table(columns, [first, *drawn[:SHOWN]], title).markdown())


def worst(row: list[Any], cells: slice) -> float:
    """Return the largest of some ratios; what failed is infinitely large."""
    return max(np.inf if value is None else value for value in row[cells])


def arm(factors: dict[str, float], exchange: float | None, path: Path) -> dict[str, Any]:
    """Return a plant, its controller file written."""
    data = read_yaml(MEKA_CONTROLLERS, dict[str, Any])
    springs = [factors["springs"] * value for value in data["springs"]["default"]]
    for joint in data["joints"]:
        joint["motor"]["friction"] *= factors["viscous friction"]
        joint["position_loop"]["k_d"] *= factors["damping of the position loops"]
        joint["range"]["slew_rate"] *= factors["slew limits"]
    path.write_text(yaml.safe_dump(data, allow_unicode=True), encoding="utf-8")
    plant = published_spec("spiral")["plant"]
    friction = [factors["dry friction"] * value for value in plant["dry_friction"]]
    return plant | {
        "controllers": str(path),
        "springs": springs,
        "dry_friction": friction,
        "exchange_period": exchange,
    }


def ratios(plant: dict[str, Any]) -> list[Cell]:
    """Return error and hand's path over those printed, for each cell; None where a run fails."""
    found: list[Cell] = []
    for name, law, label in CELLS:
        run = law if law == "K" else law + SUFFIX
        spec = with_gain_x100(published_spec(name)) | {"plant": plant}
        try:
            _, record, metrics = run_once(spec, run, label)
        except Exception as error:  # a draw that is no arm at all
            print(error, file=sys.stderr)
            found += [None, None]
            continue
        error = metrics.settled_error if name == "h-infinity" else metrics.error
        pairs = {"error": error, "hand_speed": metrics.hand_speed}
        found += [
            None if has_failed(record.stopped) else each.integral / published_mean(name, law, label, metric)
            for metric, each in pairs.items()
        ]
    return found


if __name__ == "__main__":
    main()
