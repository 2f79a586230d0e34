"""Print what the assumptions behind the reproductions of [P16] matter: `python tools/pereira2016_sensitivity.py`.

Each variant of the plant has its sag fitted anew to the error of K on the spiral with the best gains; the other columns
are ours over published then, the share T mean|u| of the sag, and how far the joints go beyond their limits.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

from scipy.optimize import root_scalar

from dqcontrol.experiments.published import published_cells
from dqcontrol.experiments.published.catalogue import spec_path
from dqcontrol.experiments.run import execute, measure
from dqcontrol.experiments.setting import prepare
from dqcontrol.experiments.tables import Column, Table
from dqcontrol.yaml_file import parse_yaml, read_text

SPRINGS = [150, 150, 75, 75, 20, 20, 20]  # N·m/rad, a usual guess for the arm's springs
VARIANTS: dict[str, dict[str, Any]] = {
    "as in the specs": {},
    "no posture": {"null_space": None},
    "posture six times as stiff": {"posture": 60},
    "one stiffness for all joints": {"stiffness": 100},
    "stiffness of springs": {"stiffness": SPRINGS},
    "τ = 25 ms": {"time_constant": 0.025},
    "τ = 100 ms": {"time_constant": 0.1},
    "no encoder noise": {"encoder_noise": 0.0},
}
CELLS = (
    ("spiral", "K", "ln2"),
    ("spiral", "K", "ln2²"),
    ("spiral", "LQR-R8", "best"),
    ("spiral", "LQR-DQ", "best"),
    ("circle", "K", "fixed"),
    ("circle", "LQR-R8", "q=1 r=0.001"),
    ("circle", "LQR-DQ", "q=1 r=0.001"),
)


def metrics(spec: str, law: str, parameters: str, variant: dict[str, Any], sag: float) -> Any:
    """Run one case of a published spec on a variant of its plant."""
    path = spec_path(spec)
    data = parse_yaml(str(path), read_text(path))
    data |= {
        "laws": {law: data["laws"][law]},
        "sets": {parameters: {law: data["sets"][parameters][law]}},
        "repeats": 1,
    }
    plant = {key: value for key, value in variant.items() if key not in ("null_space", "posture")}
    data["plant"] = data["plant"] | plant | {"sag": sag}
    if "null_space" in variant:
        del data["null_space"]
    elif "posture" in variant:
        data["null_space"]["gain"] = variant["posture"]
    setting = prepare(data)
    return measure(execute(setting, setting.cases[0]), setting.scene.robot, 0.0, "measured")


def published(spec: str, law: str, parameters: str) -> float:
    """Return the printed error."""
    wanted = (law, "" if parameters == "fixed" else parameters, "error")
    return next(cell.mean for cell in published_cells(spec) if (cell.law, cell.set, cell.metric) == wanted)


def row(label: str, variant: dict[str, Any]) -> list[Any]:
    """Fit the sag, and return a row of the table."""
    target = published("spiral", "K", "best")
    fitted = ("spiral", "K", "best", variant)
    sag = root_scalar(
        lambda value: math.log(metrics(*fitted, value).error.integral / target), bracket=(0.1, 3.0), rtol=1e-3
    ).root
    ratios = [metrics(*cell, variant, sag).error.integral / published(*cell) for cell in CELLS]
    best = metrics(*fitted, sag)
    return [label, sag, *ratios, 0.008 * best.control.mean, math.degrees(min(best.limit_margin, 0.0))]


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    columns = [Column("Variant"), Column("α", "", ".3f")]
    columns += [Column(" ".join(cell).removesuffix(" fixed"), "", ".2f") for cell in CELLS]
    columns += [Column("T mean|u|", "rad", ".3f"), Column("beyond limits", "°", ".0f")]
    print(Table(columns, [row(label, variant) for label, variant in VARIANTS.items()]).markdown())


if __name__ == "__main__":
    main()
