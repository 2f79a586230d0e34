"""Joint limits: clamping and weighted least norm against their definitions in NumPy, and what they guarantee."""

import re
import warnings

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error, InterpretedWarning
from dqcontrol.experiments.spec import read_spec
from dqcontrol.laws import (
    DampedInverse,
    DecoupledProportional,
    HInfinity,
    JointCentring,
    LimitAvoidance,
    LinearQuadraticDQ,
    OwnLaw,
    PartialProportional,
    Posture,
    Proportional,
)
from dqcontrol.limits import CommandLimits, ModifiedClamping, WeightedLeastNorm
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator, Servo
from dqcontrol.robots import Limits
from dqcontrol_theses.variants import OriginalClamping

SEED = 20260801
T = 0.01
Q0 = np.array([0.3, 0.6, -0.2, 1.6, 0.4, 0.6, 0.1])
KINDS = {
    "modified": ModifiedClamping(),
    "original": OriginalClamping(),
    "weighted": WeightedLeastNorm(),
}
LAWS = {
    "K": Proportional(gain=5.0),
    "HIR": HInfinity(orientation_gain=10.0, translation_gain=5.0),
    "LQR-DQ": LinearQuadraticDQ(error_weight=25.0, control_weight=1.0),
}


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def goals(*phases):
    """Return samples of set-points, each held for so many periods."""
    poses = np.concatenate([np.tile(pose, (count, 1)) for pose, count in phases])
    samples = np.zeros((len(poses), 21))
    samples[:, :8], samples[:, -1] = poses, T * np.arange(len(poses))
    return samples


def drive(arm, law, position, samples, q0=Q0, plant=None, velocity=False, **options):
    prepared = law.prepare(arm, None, T, CommandLimits(velocity=velocity, position=position))
    live = (plant or Integrator()).start(arm, q0, T, len(samples), 1)
    return close_loop(prepared, live, samples, **options)


def excess(arm, q):
    return np.maximum(q - arm.limits.upper, arm.limits.lower - q).max()


def pose_error(arm, q, pose):
    error = algebra.multiply(algebra.conjugate(arm.fkm(q)), pose)
    error[0] = 1 - abs(error[0])
    return np.linalg.norm(error)


# Beyond the limit of joint 4 (2.094), of joint 6 (2.094) and 1 (2.967), and of none.
SCENARIOS = {
    "elbow": ([0.3, 0.6, -0.2, 2.5, 0.4, 0.6, 0.1], [3]),
    "wrist": ([2.9, 0.6, -0.2, 1.6, 0.4, 2.4, 0.1], [5]),
    "inside": ([0.6, 0.8, 0.1, 1.2, 0.2, 0.9, 0.3], []),
}


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("kind", ["modified", "original"])
def test_there_and_back(arm, name, kind):
    """Modified: no excess and every joint regained. Original: an excess of up to one step, and stuck."""
    away, joints = SCENARIOS[name]
    law, start = Proportional(gain=20.0), Q0.copy()
    if name == "wrist":
        start[[0, 5]] = 2.7, 1.8
    home, beyond = arm.fkm(start), arm.fkm(away)
    samples = goals((beyond, 400), (home, 600))
    free = drive(arm, law, None, samples, start)
    assert (excess(arm, free.q) > 0.1) == bool(joints)
    trace = drive(arm, law, KINDS[kind], samples, start)
    back = pose_error(arm, trace.q[-1], home)
    at_limit = np.flatnonzero(np.maximum(trace.q - arm.limits.upper, arm.limits.lower - trace.q)[399] > -1e-6)
    if not joints:
        assert np.array_equal(trace.q, free.q)
        assert back < 1e-15
    elif kind == "modified":
        assert excess(arm, trace.q) <= 0.0
        assert set(joints) <= set(at_limit)
        margins = np.minimum(trace.q[-1] - arm.limits.lower, arm.limits.upper - trace.q[-1])
        assert margins.min() > 0.05, "every joint is regained"
        assert back < 1e-15
    else:
        crossed = np.flatnonzero((trace.q[-1] > arm.limits.upper) | (trace.q[-1] < arm.limits.lower))
        assert set(joints) <= set(crossed)
        steps = np.abs(np.diff(trace.q, axis=0)).max(axis=0)
        beyond_by = np.maximum(trace.q - arm.limits.upper, arm.limits.lower - trace.q).max(axis=0)
        assert (beyond_by[crossed] <= steps[crossed]).all()
        for i in crossed:
            first = int(
                np.argmax((trace.q[:, i] > arm.limits.upper[i]) | (trace.q[:, i] < arm.limits.lower[i]))
            )
            assert (trace.q[first:, i] == trace.q[first, i]).all(), "locked for ever"
        assert back > 0.01


@pytest.mark.parametrize("runs", [150, pytest.param(1000, marks=pytest.mark.slow)])
def test_random_runs_never_leave_the_limits(runs):
    """And a sample in which no joint would cross its limit is commanded as if there were no limits."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    robots = (dqc.load_robot(name) for name in dqc.robot_names())
    arms = [robot for robot in robots if isinstance(robot, dqc.SerialArm)]
    free = {(arm.name, name): law.prepare(arm, None, T) for arm in arms for name, law in LAWS.items()}
    limited = released = 0
    for k in range(runs):
        arm, name = arms[rng.integers(len(arms))], list(LAWS)[k % len(LAWS)]
        lower, upper, moved = arm.limits.lower, arm.limits.upper, arm.input_coordinates
        bounded = np.clip(lower, -3, 3), np.clip(upper, -3, 3)
        start = rng.uniform(*bounded)
        beyond = start + rng.uniform(-1.5, 1.5, len(start))
        samples = goals((arm.fkm(beyond), 100), (arm.fkm(start), 100))
        scaled = k % 2 == 1 and bool(np.isfinite(arm.limits.velocity).any())
        trace = drive(arm, LAWS[name], ModifiedClamping(), samples, start, velocity=scaled)
        assert len(trace.q) == 200, trace.stopped
        assert excess(arm, trace.q) <= 0.0
        if k >= 100 or scaled:
            continue
        law = free[arm.name, name]
        state = law.initial_state(start)
        sample_of = [dqc.Sample(samples[0, :8]), dqc.Sample(samples[-1, :8])]
        for q, u, i in zip(trace.q, trace.command, range(200), strict=True):
            wanted = law.command(q, sample_of[i >= 100], state)
            at_upper, at_lower = (q >= upper - 1e-6)[moved], (q <= lower + 1e-6)[moved]
            outwards = (at_upper & (wanted > 0)) | (at_lower & (wanted < 0))
            if outwards.any():
                limited += 1
                assert (u[outwards] == 0).all()
                continue
            least, most = ((lower - q) / T)[moved], ((upper - q) / T)[moved]
            if (
                crossing := (wanted < least) | (wanted > most)
            ).any():  # the others make up for the worst of them
                worst = int((np.maximum(least - wanted, wanted - most) * crossing).argmax())
                assert u[worst] == pytest.approx(np.clip(wanted, least, most)[worst], rel=1e-9, abs=1e-12)
            else:
                released += limited > 0
                assert u == pytest.approx(wanted, rel=1e-9)
    assert limited > 500
    assert released > 500


@pytest.mark.parametrize("velocity", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "law",
    [
        Proportional(gain=5.0, null_space=Posture(gain=1.0)),
        HInfinity(orientation_gain=9.0, translation_gain=5.0, null_space=LimitAvoidance(gain=0.01)),
        DecoupledProportional(gain=5.0, inverse=DampedInverse(damping=0.05)),
        PartialProportional(part="position", gain=5.0, null_space=JointCentring(gain=5.0)),
    ],
    ids=["K", "HIR", "decoupled", "position"],
)
def test_compiled_and_interpreted_are_equal_to_the_last_bit(arm, law, kind, velocity):
    samples = goals((arm.fkm(SCENARIOS["elbow"][0]), 150), (arm.fkm(Q0), 100))
    for plant in (Integrator(), Servo(encoder_noise=1e-4)):
        traces = [
            drive(arm, law, KINDS[kind], samples, plant=plant, velocity=velocity, interpreted=mode)
            for mode in (False, True)
        ]
        assert len(traces[0].q) == 250
        for field in ("q", "measured", "command"):
            assert np.array_equal(getattr(traces[0], field), getattr(traces[1], field)), field
        again = drive(arm, law, None, samples, plant=plant, velocity=velocity)
        assert not np.array_equal(traces[0].command, again.command), "the limit had something to do"


def counting(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Drive joint 1 out with all joints, and count samples."""
    state[0] += 1.0
    for i in range(out.shape[0]):
        out[i] = 0.5 + pose_jacobian[0, i] - pose_jacobian[0, i]


def counting_interpreted(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Do the same in a way that does not compile."""
    state[0] += 1.0
    out[:] = np.asarray([object(), 0.5][1:]).astype(float).repeat(len(out))


@pytest.mark.parametrize("function", [counting, counting_interpreted])
@pytest.mark.parametrize("interpreted", [False, True])
def test_the_state_of_a_law_advances_once_a_sample(arm, function, interpreted):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InterpretedWarning)
        law = OwnLaw(function=function, memory=2)
        prepared = law.prepare(arm, None, T, CommandLimits(position=ModifiedClamping()))
    kept = []
    prepared.initial_state = lambda q: kept.append(np.zeros(2)) or kept[-1]
    samples = goals((arm.fkm(Q0), 900))
    trace = close_loop(prepared, Integrator().start(arm, Q0, T, 900, 0), samples, interpreted=interpreted)
    assert kept[0].tolist() == [900.0, 0.0]
    assert np.array_equal(trace.q[-1], np.minimum(trace.q[-1], arm.limits.upper))
    assert trace.q[-1] == pytest.approx(arm.limits.upper, abs=2e-6), "all are at their limits"
    assert (trace.command[-1] == 0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_joints_without_limits_are_passed_over(kind):
    inf = np.full(7, np.inf)
    bounded = dqc.load_robot("iiwa7")
    upper = bounded.limits.upper.copy()
    upper[[0, 2, 4, 5, 6]] = np.inf
    lower = np.where(np.isfinite(upper), bounded.limits.lower, -np.inf)
    arm = dqc.SerialArm(bounded.chain[:, :7], bounded.joint_types, limits=Limits(lower, upper, inf, inf))
    samples = goals((arm.fkm(SCENARIOS["elbow"][0]), 300), (arm.fkm(Q0), 300))
    trace = drive(arm, LAWS["K"], KINDS[kind], samples)
    assert np.isfinite(trace.command).all()
    assert trace.stopped == "duration"
    if kind == "modified":
        assert excess(arm, trace.q) <= 0.0
        assert pose_error(arm, trace.q[-1], arm.fkm(Q0)) < 1e-5


def test_a_start_outside_the_limits_comes_in_and_goes_no_further_out(arm):
    start = Q0.copy()
    start[3] = arm.limits.upper[3] + 0.3
    inside = drive(arm, LAWS["K"], ModifiedClamping(), goals((arm.fkm(Q0), 300)), start)
    assert (np.diff(inside.q[:, 3]) <= 0).all()
    assert np.abs(inside.command[0]).max() < 20, "no leap to the limit within one period"
    assert inside.q[-1, 3] < arm.limits.upper[3]
    away = start.copy()
    away[3] += 0.4
    outside = drive(arm, LAWS["K"], ModifiedClamping(), goals((arm.fkm(away), 300)), start)
    assert (outside.q[:, 3] <= start[3]).all()


@pytest.mark.parametrize("velocity", [False, True])
@pytest.mark.parametrize("gain", [1.0, 77.7, 99.9])
def test_limits_are_reached_and_not_crossed_by_rounding(arm, gain, velocity):
    """Steps of a whole range at once: the clip alone must hold them."""
    rng = np.random.default_rng(SEED)
    for _ in range(20):
        start = rng.uniform(arm.limits.lower, arm.limits.upper)
        goal = arm.fkm(start + rng.uniform(-3, 3, 7))
        law = Proportional(gain=gain)
        trace = drive(arm, law, ModifiedClamping(), goals((goal, 60)), start, velocity=velocity)
        assert excess(arm, trace.q) <= 0.0


@pytest.mark.parametrize("position", [{"kind": "modified-clamping", "tolerance": 1e-4},
                                      {"kind": "original-clamping"}, {"kind": "weighted-least-norm"}])  # fmt: skip
def test_a_spec_chooses(position):
    data = {
        "name": "clamped", "robot": "iiwa7", "start": Q0.tolist(), "period": T, "duration": 1.0,
        "reference": {"kind": "set-point"}, "law": {"kind": "proportional", "gain": 3.0},
        "plant": {"kind": "integrator"}, "limits": {"velocity": True, "position": position},
    }  # fmt: skip
    spec, _ = read_spec(data)
    assert type(spec.limits.position).__struct_config__.tag == position["kind"]
    assert dqc.run(data).record.stopped == "duration"
    position["tolerance"] = -1.0
    text = "tolerance: .*>= 0" if position["kind"].startswith("mod") else "unknown key 'tolerance'"
    with pytest.raises(Error, match="limits.position.*" + text):
        read_spec(data)


@pytest.mark.parametrize(
    ("tolerance", "text"),
    [
        (-1e-3, "limits.position.tolerance: must be ≥ 0, got -0.001"),
        (np.nan, "limits.position.tolerance: must be finite, got nan"),
    ],
)
def test_bad_tolerances_are_refused(tolerance, text):
    with pytest.raises(Error, match=re.escape(text)):
        ModifiedClamping(tolerance=tolerance)


@pytest.mark.parametrize("kind", KINDS)
def test_position_limits_need_a_robot_that_has_some(make_arm, kind):
    with pytest.raises(Error, match=r"limits.position: arm of 6 has no joint limits to keep"):
        LAWS["K"].prepare(make_arm(6), None, T, CommandLimits(position=KINDS[kind]))
