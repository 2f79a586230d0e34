"""Print what the assumptions behind the reproductions of [P16] matter.

`python -m dqcontrol_theses.pereira2016.tools.sensitivity` for the arm in physics, `… servo` for servos; names of
variants after that choose some. `… iiwa` for the simulated iiwa of appendix C, whose simulator is not described.

Each variant runs twice: with the plant's first number as it is in use, and with that number fitted anew to the error
of K on the spiral with the best gains. The columns are ours over published, and the share T mean|u| that the arm gives
way. On servos: how far the joints go beyond their limits. In physics: L.Acc of K on the spiral, Eff, L.Vel and L.Acc
of K on the circle; the loop gain k T at which K starts to shake on the spiral, so that its hand moves twice the
printed 1.409 m; the robust laws with their gains times a factor; and what the damping λ of P16's pseudoinverses would
do.
"""

from __future__ import annotations

import math
import sys
import tempfile
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

from scipy.optimize import root_scalar

from dqcontrol.loop import has_failed
from dqcontrol.measures import Metrics
from dqcontrol.tables import Column, Table
from dqcontrol_theses.pereira2016 import PLANTS, published_spec
from dqcontrol_theses.pereira2016.calibration import FITS
from dqcontrol_theses.pereira2016.gain_x100 import SUFFIX, with_gain_x100
from dqcontrol_theses.pereira2016.pereira2016_catalogue import MEKA_CONTROLLERS, PHYSICS, SERVO, run_once
from dqcontrol_theses.pereira2016.published_numbers import FIXED, published_mean

PERIOD = 0.008  # s, of the spiral
USUAL_SPRINGS = [150, 150, 75, 75, 20, 20, 20]  # N·m/rad, a usual guess for the arm's springs
TWICE_AS_STIFF = [600, 600, 300, 300, 80, 80, 80]  # N·m/rad, as the plant's default springs
NO_POSTURE = {"null_space": None}

Variant = dict[str, Any]
SERVOS: dict[str, Variant] = {
    "as in the specs": {},
    "no posture": NO_POSTURE,
    "posture six times as stiff": {"posture": 60},
    "one stiffness for all joints": {"stiffness": 100},
    "stiffness of springs": {"stiffness": USUAL_SPRINGS},
    "τ = 25 ms": {"time_constant": 0.025},
    "τ = 100 ms": {"time_constant": 0.1},
    "no encoder noise": {"encoder_noise": 0.0},
}
FRICTION = [2, 2, 1, 1, 0.3, 0.3, 0.3]  # N·m, as in use
WITHOUT: Variant = {"exchange_period": None, "dry_friction": 0.0, "base_shaking": 0.0}
IN_PHYSICS: dict[str, Variant] = {
    "as chosen": {},
    "no exchange, friction or shaking": WITHOUT,
    "exchange at 100 Hz alone": WITHOUT | {"exchange_period": 0.01},
    "dry friction alone": WITHOUT | {"dry_friction": FRICTION},
    "shaking base alone": WITHOUT | {"base_shaking": 0.029},
    "half the dry friction": {"dry_friction": [0.5 * each for each in FRICTION]},
    "twice the dry friction": {"dry_friction": [2 * each for each in FRICTION]},
    "springs twice as stiff": {"springs": TWICE_AS_STIFF},
    "soft springs": {"springs": "soft"},
    "no hand": {"hand": False},
    "no hand, springs twice as stiff": {"hand": False, "springs": TWICE_AS_STIFF},
    "no hand, soft springs": {"hand": False, "springs": "soft"},
    "mode THETA": {"mode": "THETA"},
    "mode THETA, no hand": {"mode": "THETA", "hand": False},
    "feedforward 1": {"feedforward": 1},
    "stiffness 0.8": {"stiffness": 0.8},
    "no posture": NO_POSTURE,
    "posture at 1 1/s": {"posture": 1},
    "posture at 20 1/s": {"posture": 20},
    "start not turned": {"turned": [0, 0, 0]},
    "start turned by −0.1 rad": {"turned": [0, -0.1, 0]},
    "start turned about x": {"turned": [0.1, 0, 0]},
    "start turned about z": {"turned": [0, 0, 0.1]},
    "no posture, start not turned": NO_POSTURE | {"turned": [0, 0, 0]},
    "start on the path": {"turned": [0, 0, 0], "moved": [0, 0, 0]},
    "Riccati solved exactly": {"riccati": "exact"},
    "no encoder noise": {"encoder_noise": 0.0},
    "Runge-Kutta steps": {"accurate": True},
}
OF_THE_START = {"turned": "rotation", "moved": "translation"}
FITTED = ("spiral", "K", "best")
FIRST_GUESSES = {SERVO: (0.7, 1.0), PHYSICS: (0.77, 0.65)}
CELLS = (
    ("spiral", "K", "ln2"),
    ("spiral", "K", "ln2²"),
    ("spiral", "LQR-R8", "best"),
    ("spiral", "LQR-DQ", "best"),
    ("circle", "K", FIXED),
    ("circle", "LQR-R8", "q=1 r=0.001"),
    ("circle", "LQR-DQ", "q=1 r=0.001"),
)
ON_THE_IIWA: dict[str, Variant] = {
    "as chosen: measured + T u, τ = 60 ms": {},
    "last target + T u": {"command_mode": "integrated"},
    "τ = 30 ms": {"time_constant": 0.03},
    "τ = 90 ms": {"time_constant": 0.09},
    "one period of delay": {"delay": 0.025},
    "τ = 35 ms, one period of delay": {"time_constant": 0.035, "delay": 0.025},
    "last target + T u, one period of delay": {"command_mode": "integrated", "delay": 0.025},
}
IIWA_LAWS = {"K": FIXED, "K+FF": FIXED, "LQR-R8": "q=1 r=0.001"}
GAIN, SPEED = 125.0, 1.409  # of K, spiral, best: gain, 1/s, and printed integral of the hand's speed, m
FACTORS = (20, 30, 40, 60, 100)
DAMPINGS = (1e-6, 0.03, 0.1, 0.2)  # λ of the damped pseudoinverse


def metrics(spec: dict[str, Any], law: str, parameters: dict[str, Any], variant: Variant) -> Metrics | None:
    """Run one law of a published spec on a variant of its plant; None if it fails."""
    data = dict(spec)
    changes = dict(variant)
    start = {OF_THE_START[key]: changes.pop(key) for key in OF_THE_START if key in changes}
    if start:
        reference = data["reference"]
        data["reference"] = reference | {"offset": reference["offset"] | start}
    if changes.pop("riccati", None) and data["laws"][law]["kind"] == "linear-quadratic-r8-euler":
        parameters = parameters | {"kind": "linear-quadratic-r8"}
    if "null_space" in changes:
        del data["null_space"], changes["null_space"]
    elif "posture" in changes:
        data["null_space"] = data["null_space"] | {"gain": changes.pop("posture")}
    data["plant"] = data["plant"] | changes
    _, record, found = run_once(data, law, **parameters)
    return None if has_failed(record.stopped) else found


def cell(plant: str, place: tuple[str, str, str], variant: Variant) -> Metrics | None:
    """Run a cell of the published tables."""
    name, law, parameters = place
    spec = published_spec(name, plant)
    return metrics(spec, law, spec["parameter_sets"][parameters][law], variant)


def error(found: Metrics | None) -> float:
    """Return the error of a run that did not fail."""
    return math.nan if found is None else found.error.integral


def fitted(plant: str, variant: Variant) -> float | None:
    """Return the plant's one number, fitted to the error of K; None where runs fail on the way."""
    target, key = published_mean(*FITTED), FITS[plant][0].key

    def distance(value: float) -> float:
        found = cell(plant, FITTED, variant | {key: value})
        if found is None:
            raise ArithmeticError
        return found.error.integral - target

    with suppress(ArithmeticError):
        low, high = FIRST_GUESSES[plant]
        return float(root_scalar(distance, method="secant", x0=low, x1=high, rtol=1e-3).root)
    return None


def limit(plant: str, variant: Variant) -> float:
    """Return the k T at which K starts to shake, to 0.05; infinite beyond 4."""
    low, high = 0.4, 4.0
    spec = published_spec("spiral", plant)

    def shakes(loop_gain: float) -> bool:
        found = metrics(spec, "K", {"gain": loop_gain / PERIOD}, variant)
        return found is None or found.hand_speed.integral > 2 * SPEED

    if not shakes(high):
        return math.inf
    while high - low > 0.05:
        middle = (low + high) / 2
        low, high = (low, middle) if shakes(middle) else (middle, high)
    return high


def rows(plant: str, label: str, variant: Variant) -> list[list[Any]]:
    """Return a variant's rows of the table: with the plant's number as it is, and fitted again."""
    if not variant or "mode" in variant:  # the servos of THETA know no gravity
        return [row(plant, label, variant, None)]
    number = fitted(plant, variant)
    again = [] if number is None else [row(plant, f"{label}, fitted again", variant, number)]
    return [row(plant, label, variant, None), *again]


def row(plant: str, label: str, variant: Variant, number: float | None) -> list[Any]:
    """Return what a variant gives with the plant's number, None for the one in use."""
    key = FITS[plant][0].key
    if number is None:
        number = published_spec("spiral", plant)["plant"][key]
    else:
        variant = variant | {key: number}
    ratios = [error(cell(plant, place, variant)) / published_mean(*place) for place in (FITTED, *CELLS)]
    best = cell(plant, FITTED, variant)
    share = math.nan if best is None else PERIOD * best.control.mean
    if plant == SERVO:
        beyond = math.nan if best is None else math.degrees(min(best.limit_margin, 0.0))
        return [label, number, *ratios, share, beyond]
    circle = cell(plant, ("circle", "K", FIXED), variant)
    rough = [
        math.nan if found is None else getattr(found, metric).integral / published_mean(*place, metric)
        for found, place, metric in (
            (best, ("spiral", "K", "best"), "hand_acceleration"),
            *(
                (circle, ("circle", "K", FIXED), each)
                for each in ("joint_step", "hand_speed", "hand_acceleration")
            ),
        )
    ]
    return [label, number, *ratios, share, *rough, limit(plant, variant)]


def table(plant: str, variants: dict[str, Variant]) -> Table:
    """Return the table of a plant's variants."""
    columns = [Column("Variant"), Column("α" if plant == SERVO else "f", "", ".3f")]
    columns += [
        Column(" ".join(place).removesuffix(f" {FIXED}"), "", ".3f" if place == FITTED else ".2f")
        for place in (FITTED, *CELLS)
    ]
    columns += [Column("T mean|u|", "rad", ".3f")]
    if plant == SERVO:
        columns += [Column("beyond limits", "°", ".0f")]
    else:
        columns += [Column("L.Acc, spiral K best", "", ".2f")]
        columns += [Column(f"{metric}, circle K", "", ".2f") for metric in ("Eff", "L.Vel", "L.Acc")]
        columns += [Column("K shakes from k T", "", ".2f")]
    return Table(
        columns, [each for label, variant in variants.items() for each in rows(plant, label, variant)]
    )


def robust_laws() -> Table:
    """Return what HIR does in physics with all gains times a factor, as printed and turning as fast as it moves."""
    rows = []
    for factor in FACTORS:
        spec = with_gain_x100(published_spec("spiral", PHYSICS), factor)
        printed = spec["laws"][f"HIR{SUFFIX}"]
        slow = printed["translation_gain"]
        # The orientation's error is half an angle: twice the gain makes turning as fast as moving.
        even = {"orientation_gain": slow | {"values": [2 * value for value in slow["values"]]}}
        cells: list[Any] = [factor, PERIOD * slow["values"][-1]]
        for parameters in ({}, even):
            found = metrics(spec, f"HIR{SUFFIX}", parameters, {})
            speed = math.nan if found is None else found.hand_speed.integral
            cells += [error(found) / published_mean("spiral", "HIR", "best")]
            cells += [speed / published_mean("spiral", "HIR", "best", "hand_speed")]
        rows.append(cells)
    names = ("Err", "L.Vel", "Err, turning as fast", "L.Vel, turning as fast")
    columns = [Column("HIR, gains times", "", "g"), Column("k T of its position", "", ".2f")]
    return Table([*columns, *(Column(name, "", ".2f") for name in names)], rows)


def damped_inverse() -> Table:
    """Return what the damping of the pseudoinverse that three footnotes of [P16] name does to errors and commands."""
    rows: list[list[Any]] = []
    for damping in DAMPINGS:
        row: list[Any] = [damping]
        for law in ("K", "LQR-R8", "LQR-DQ"):
            spec = published_spec("spiral", PHYSICS)
            found = metrics(spec, law, {"inverse": {"kind": "damped", "damping": damping}}, {})
            row += [error(found) / published_mean("spiral", law, "best")]
            row += [
                math.nan
                if found is None
                else found.control.integral / published_mean("spiral", law, "best", "control")
            ]
        rows.append([*row, row[5] / row[1]])
    names = [f"{law}: {metric}" for law in ("K", "LQR-R8", "LQR-DQ") for metric in ("Err", "θ̇")]
    columns = [Column("λ", "", "g"), *(Column(name, "", ".2f") for name in names)]
    title = (
        "Damped pseudoinverse of P16's footnotes, spiral, best gains; ours over printed, nothing fitted anew"
    )
    return Table([*columns, Column("Err of LQR-DQ over K's", "", ".2f")], rows, title)


def iiwa() -> Table:
    """Return Err of the iiwa over the printed ones, circle and square, for readings of its simulator."""
    rows = []
    for label, variant in ON_THE_IIWA.items():
        cells: list[Any] = [label]
        for shape in ("circle", "square"):
            spec = published_spec(f"iiwa-{shape}")
            for law, parameters in IIWA_LAWS.items():
                found = metrics(spec, law, spec["parameter_sets"][parameters][law], variant)
                cells.append(
                    error(found)
                    / published_mean("circle-and-square", law, parameters, "error", f"iiwa {shape}")
                )
        rows.append(cells)
    names = [f"{shape}: {law}" for shape in ("circle", "square") for law in IIWA_LAWS]
    columns = [Column("Simulator"), *(Column(name, "", ".2f") for name in names)]
    return Table(columns, rows, "Err on the iiwa over print")


def with_feedforward(folder: str) -> str:
    """Write the Meka's controllers with feed-forward in their torque loops, and return the file."""
    text = MEKA_CONTROLLERS.read_text(encoding="utf-8")
    path = Path(folder) / "feedforward.yaml"
    path.write_text(text.replace("feedforward: 0}", "feedforward: 1}"), encoding="utf-8")
    return str(path)


def main() -> None:
    """Print the tables."""
    warnings.simplefilter("ignore")
    plant = sys.argv[1] if len(sys.argv) > 1 else PLANTS[0]
    if plant == "iiwa":
        print(iiwa().markdown())
        return
    if plant not in PLANTS:
        sys.exit(f"plant: one of {', '.join(PLANTS)}")
    known, wanted = SERVOS if plant == SERVO else IN_PHYSICS, sys.argv[2:]
    if unknown := set(wanted) - set(known):
        sys.exit(f"variants: no {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    chosen = {label: variant for label, variant in known.items() if label in (wanted or known)}
    if plant == SERVO:
        print(table(plant, chosen).markdown())
        return
    with tempfile.TemporaryDirectory() as folder:
        file = with_feedforward(folder)
        variants = {
            label: {"controllers": file} if "feedforward" in variant else variant
            for label, variant in chosen.items()
        }
        print(table(plant, variants).markdown())
    if not wanted:
        print(robust_laws().markdown())
        print(damped_inverse().markdown())


if __name__ == "__main__":
    main()
