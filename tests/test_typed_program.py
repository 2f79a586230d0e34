# pyright: strict, reportUnknownMemberType=false
"""A user's program that uses most public names: `make lint` has mypy and pyright check it as strictly as they can."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import dqcontrol as dqc
from dqcontrol.experiments import run as run_spec
from dqcontrol.loop import simulate
from dqcontrol.measures import evaluate

Array = NDArray[np.float64]


def transposed(
    q: Array,
    pose: Array,
    pose_jacobian: Array,
    twist_jacobian: Array,
    sample: Array,
    parameters: Array,
    state: Array,
    work: Array,
    out: Array,
) -> None:
    """q̇ = k Jᵀ vec8(x_d − x)."""
    for i in range(out.shape[0]):
        out[i] = 0.0
        for k in range(8):
            out[i] += parameters[0] * pose_jacobian[k, i] * (sample[k] - pose[k])


def errors_of_laws(folder: Path) -> dict[str, float]:
    """Compare laws, and draw where the hand was."""
    arm: dqc.Robot = dqc.load_robot("iiwa7")
    q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    circle = dqc.references.Circle(arm.fkm(q), radius=0.05, duration=1.0)
    laws: dict[str, dqc.laws.Law] = {
        "own": dqc.laws.OwnLaw(function=transposed, parameters=[50.0]),
        "K": dqc.laws.Proportional(gain=5.0),
    }
    records: dict[str, dqc.Record] = {}
    for label, law in laws.items():
        records[label] = dqc.simulate(arm, circle, law, dqc.plants.Servo(), start=q, period=0.01)
    records["again"] = simulate(arm, circle, laws["K"], dqc.plants.Servo(), start=q, period=0.01)
    dqc.figures.compare_paths(records).savefig(folder / "paths.png")
    return {label: evaluate(record).position.rms for label, record in records.items()}


def run_of_spec() -> dqc.Run:
    """Run a spec in both spellings."""
    spec = {
        "name": "set-point",
        "robot": "iiwa7",
        "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
        "period": 0.01,
        "reference": {"kind": "set-point", "offset": {"translation": [0, 0, 0.05]}},
        "duration": 0.5,
        "plant": {"kind": "servo"},
        "law": {"kind": "proportional", "gain": 5},
    }
    assert run_spec(spec).metrics == dqc.run(spec).metrics
    return dqc.run(spec)


def step_by_hand() -> float:
    """Command one step and return how far the hand still is, m."""
    arm, q = dqc.load_robot("panda"), np.array([0, 0, 0, -1.6, 0, 1.6, 0.8])
    target = dqc.DualQuaternion.from_translation([0, 0, 0.01]) * dqc.DualQuaternion(arm.fkm(q))
    solution: dqc.Solution = arm.solve(target)
    law = dqc.laws.ProportionalFeedforward(gain=10.0).prepare(
        arm, dqc.references.SetPoint(target), period=0.01
    )
    state = law.initial_state(q)
    sample = dqc.Sample(target)
    q = q + 0.01 * law.command(q, sample, state)
    assert arm.fkm(solution.q).shape == sample.pose.shape
    return float(np.abs(arm.fkm(q) - sample.pose).max())


def test_it_also_runs(tmp_path: Path) -> None:
    errors = errors_of_laws(tmp_path)
    assert set(errors) == {"own", "K", "again"}
    assert errors["K"] == errors["again"]
    assert (tmp_path / "paths.png").exists()
    assert run_of_spec().metrics.position.rms > 0
    assert step_by_hand() < 0.01


def test_the_package_lists_what_users_need_and_nothing_else() -> None:
    shown = [name for name in dir(dqc) if not name.startswith("_")]
    assert shown == sorted(dqc.__all__)
    assert all(hasattr(dqc, name) for name in dqc.__all__)
