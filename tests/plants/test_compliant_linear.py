"""The linear model of compliant arms: against the arm itself, and the gain from which it shakes."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.experiments import check
from dqcontrol.measures.stability import gain_limits
from dqcontrol.plants import CompliantPlant
from dqcontrol.plants.linear_model import LinearModel

pytest.importorskip("mujoco")

SLOW = pytest.mark.slow
STARTS = {
    "meka-a2": np.array([0, np.pi / 3.7, 0, np.pi / 2, 0, np.pi / 3.7, 0]),
    "iiwa7": np.array([0, 0.6, 0, 1.6, 0, 0.6, 0]),
}
CASES = {
    "meka, measured": ("meka-a2", 0.008, {"hand": True, "command_mode": "measured", "gravity_factor": 0.774}),
    "meka, 20 ms": ("meka-a2", 0.02, {"hand": True, "command_mode": "measured", "gravity_factor": 0.774}),
    "iiwa": ("iiwa7", 0.008, {}),
    "iiwa, elastic": ("iiwa7", 0.008, {"springs": "elastic"}),
}


def motions(robot, plant, q0, gain, period):
    """Return how much the joints move in each quarter of six seconds under u = −k (q − q0), after a small kick."""
    live = plant.start(robot, q0, period, 1, 0)
    bias = (live.target - live.measured) / period if plant.command_mode == "measured" else 0 * q0
    moves = []
    for k in range(int(6 / period)):
        before = live.q.copy()
        live.step(bias - gain * (live.measured - q0 + (1e-3 if k == 5 else 0.0)))
        moves.append(live.q - before)
    return [float(np.linalg.norm(part)) for part in np.array_split(np.array(moves), 4)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", ["iiwa", *(pytest.param(case, marks=SLOW) for case in CASES if case != "iiwa")]
)
def test_the_arm_shakes_from_the_gain_that_the_model_says(case):
    name, period, options = CASES[case]
    robot, q0, plant = dqc.load_robot(name), STARTS[name], CompliantPlant(**options)
    limit = gain_limits(plant.linear_model(robot, q0, period), period).stable / period
    _, _, third, below = motions(robot, plant, q0, 0.9 * limit, period)
    _, _, before, above = motions(robot, plant, q0, 1.1 * limit, period)
    assert below < 1.2 * third
    assert above > 1.6 * before
    assert above > 10 * below


@pytest.mark.parametrize(
    ("name", "springs"),
    [
        ("iiwa7", "default"),
        pytest.param("iiwa7", "elastic", marks=SLOW),
        pytest.param("meka-a2", "default", marks=SLOW),
        pytest.param("meka-a2", [None] * 7, marks=SLOW),
    ],
)
def test_arms_stand_by_themselves_wherever_they_are(name, springs):
    robot = dqc.load_robot(name)
    for q in np.random.default_rng(20261121).uniform(
        0.9 * robot.limits.lower, 0.9 * robot.limits.upper, (3, 7)
    ):
        model = CompliantPlant(springs=springs, gravity_factor=1.0).linear_model(robot, q, 0.008)
        assert model is not None
        assert np.abs(np.linalg.eigvals(model.transition)).max() < 1 + 1e-6  # 1: targets stay where they are


def test_a_plant_far_beyond_stability_has_a_model_that_says_so():
    robot, q0 = dqc.load_robot("iiwa7"), STARTS["iiwa7"]
    model = CompliantPlant(springs=[100.0] * 7).linear_model(robot, q0, 0.008)
    assert model is not None
    assert gain_limits(model, 0.008).stable == 0


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["integrated", "measured"])
@pytest.mark.parametrize("period", [0.001, 0.004, 0.008, 0.02])
def test_no_state_that_matters_is_left_out(mode, period, monkeypatch):
    robot, q0 = dqc.load_robot("meka-a2"), STARTS["meka-a2"]
    plant = CompliantPlant(command_mode=mode, hand=True)
    few = plant.linear_model(robot, q0, period)
    monkeypatch.setattr(LinearModel, "reduced", lambda model, horizon: model)
    all_ = plant.linear_model(robot, q0, period)
    assert few is not None
    assert all_ is not None
    assert len(few.transition) < 100 < len(all_.transition)
    limit = gain_limits(few, period).stable
    assert limit > 0
    for share, stable in ((0.999, True), (1.001, False)):
        assert (np.abs(all_.poles(share * limit / period)).max() < 1) == stable


def test_modes_that_do_not_follow_angles_have_none():
    robot, q0 = dqc.load_robot("meka-a2"), STARTS["meka-a2"]
    for mode in ("TORQUE_GC", "OFF", "THETA_GC_MJ"):
        assert CompliantPlant(mode=mode).linear_model(robot, q0, 0.008) is None


@pytest.mark.parametrize("stiffness", [0.0, [0.0, 1, 1, 1, 1, 1, 1]])
def test_joints_that_commands_do_not_move_have_none_and_the_arm_runs(stiffness):
    """Its own weight is held by the model of gravity, as far as the torque loops make of it."""
    robot, q0 = dqc.load_robot("meka-a2"), STARTS["meka-a2"]
    plant = CompliantPlant(stiffness=stiffness)
    model = plant.linear_model(robot, q0, 0.008)
    assert model is None or np.isfinite(model.transition).all()
    if stiffness == 0.0:
        assert model is None
    record = dqc.simulate(
        robot,
        dqc.references.SetPoint(robot.fkm(q0)),
        dqc.laws.Proportional(gain=1.0),
        plant,
        q0,
        0.008,
        duration=0.2,
    )
    assert record.stopped == "duration"


@SLOW
def test_check_judges_compliant_arms():
    spec = {
        "name": "shaking",
        "robot": "meka-a2",
        "start": STARTS["meka-a2"].tolist(),
        "period": 0.008,
        "reference": {"kind": "set-point", "duration": 1},
        "laws": {"slow": {"kind": "proportional", "gain": 3}, "fast": {"kind": "proportional", "gain": 300}},
        "plants": {
            "measured": {"kind": "compliant", "command_mode": "measured", "hand": True},
            "integrated": {"kind": "compliant", "hand": True},
            "soft springs": {"kind": "compliant", "springs": "lower-bound"},
        },
    }
    found = {row.names.label: row for row in check(spec)}
    assert found["slow · measured"].verdict == "good"
    assert found["fast · measured"].verdict == "unstable"
    assert found["slow · integrated"].verdict == "oscillatory"
    assert found["slow · soft springs"].verdict == "unstable"
    assert "with any gain" in found["slow · soft springs"].remark
