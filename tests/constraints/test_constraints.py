"""Laws that keep constraints: against brute force between samples, in every state, and equal to the law elsewhere."""

import numpy as np
import pytest
from constraint_scenes import HOME, least_room, random_constraints, random_goal
from obstacles import around, box, plane, sphere

import dqcontrol as dqc

ARM = dqc.load_robot("panda")
PLANT = dqc.plants.Integrator()


def run(rng, period, duration=1.5, **options):
    """Return the least room beyond what was asked, and the record, of a random scene."""
    given = random_constraints(rng, ARM, HOME, **options)
    law = dqc.laws.Proportional(gain=3.0, constraints=given)
    goal = random_goal(rng, ARM)
    record = dqc.simulate(ARM, goal, law, PLANT, HOME, period=period, duration=duration)
    prepared = law.prepare(ARM, goal, period)
    return least_room(prepared, record, period), record, prepared


def test_without_a_row_that_presses_the_law_is_left_bit_for_bit():
    ball = sphere(center=(3.0, 0.0, 0.0), radius=0.1)
    given = dqc.constraints.Constraints(**around({"ball": ball}))
    goal = dqc.references.SetPoint(ARM.fkm(HOME + 0.05))
    laws = [dqc.laws.Proportional(gain=1.0, constraints=keep) for keep in (None, given)]
    commands = [dqc.simulate(ARM, goal, law, PLANT, HOME, period=0.01, duration=1.0).command for law in laws]
    assert np.array_equal(*commands)


@pytest.mark.parametrize("acceleration", [None, 10.0])
def test_nothing_is_crossed_between_samples(acceleration):
    rng = np.random.default_rng(1)
    for period in (0.001, 0.005, 0.01, 0.01):
        room, record, _ = run(rng, period, 0.5, acceleration=acceleration)
        assert np.isfinite(record.command).all()
        assert room > -1e-9


def test_joints_that_lag_keep_their_limits_and_what_is_asked():
    rng = np.random.default_rng(8)
    servo = dqc.plants.Servo(time_constant=0.03, delay=0.01)
    for _ in range(3):
        given = random_constraints(rng, ARM, HOME, acceleration=10.0)
        law = dqc.laws.Proportional(gain=3.0, constraints=given)
        record = dqc.simulate(ARM, random_goal(rng, ARM), law, servo, HOME, period=0.005, duration=1.0)
        assert record.readings["constraint_room"].values.min() > -1e-3  # 0 in each of 100 such runs
        assert (record.q <= ARM.limits.upper + 1e-9).all()
        assert (record.q >= ARM.limits.lower - 1e-9).all()


@pytest.mark.slow
def test_nothing_is_crossed_in_a_thousand_random_runs():
    rng = np.random.default_rng(2)
    shortfalls, excess = [], []
    for _ in range(1000):
        acceleration = float(rng.uniform(5, 20)) if rng.random() < 0.5 else None
        room, record, _ = run(rng, float(rng.uniform(0.001, 0.01)), acceleration=acceleration)
        shortfalls.append(-room)
        excess.append(record.readings["constraint_effect"].values[:, 3].max())
        assert np.isfinite(record.command).all()
    assert max(shortfalls) < 1e-9
    assert max(excess) < 1e-9


LATE = {  # goal, obstacles, period, acceleration: rows alone exceed the limit by 65 %, 21 %, 880 % and 59 % of itself
    "itself": ([-0.075, 1.536, -1.311, -1.608, 0.344, 0.006, 1.049], {}, 0.00208, 6.26),
    "ball": (
        [1.592, -1.61, -1.919, -1.117, 1.086, 2.313, 1.936],
        {"ball": sphere(center=(0.412, -0.279, 0.496), radius=0.057)},
        0.00169,
        7.24,
    ),
    "box": (
        [1.277, 0.643, -0.084, -0.382, 2.433, 1.936, 0.399],
        {"box": box(position=(0.074, 0.233, 0.868), size=(0.2, 0.1, 0.15), rpy=(0.3, 0.2, 0.5))},
        0.00251,
        19.75,
    ),
    "table": (
        [0.778, 1.54, 0.684, -1.162, 1.995, 0.143, 2.069],
        {"table": plane(normal=(0, 0, 1), offset=-0.05)},
        0.00576,
        8.01,
    ),
}


@pytest.mark.parametrize("before", LATE)
def test_a_fast_arm_brakes_in_time_within_its_limits_of_acceleration(before):
    there, obstacles, period, acceleration = LATE[before]
    given = dqc.constraints.Constraints(margin=0.01, **around(obstacles), acceleration=acceleration)
    law = dqc.laws.Proportional(gain=3.0, constraints=given)
    goal = dqc.references.SetPoint(ARM.fkm(np.array(there)))
    record = dqc.simulate(ARM, goal, law, PLANT, HOME, period=period, duration=0.5)
    changes = np.diff(record.command[:-1], axis=0, prepend=np.zeros((1, 7)))
    assert np.abs(changes).max() <= acceleration * period * (1 + 1e-9)
    assert least_room(law.prepare(ARM, goal, period), record, period) > -1e-9


def test_limits_of_joints_are_kept_with_acceleration():
    rng = np.random.default_rng(3)
    room, record, _ = run(rng, 0.01, 1.0, acceleration=8.0)
    limits = ARM.limits
    assert (record.q >= limits.lower - 1e-12).all()
    assert (record.q <= limits.upper + 1e-12).all()
    assert (np.abs(record.command) <= limits.velocity + 1e-12).all()
    before = np.vstack([np.zeros(7), record.command[:-1]])
    assert np.abs(record.command - before).max() <= 8.0 * 0.01 * (1 + 1e-6)
    assert room > -1e-9
    assert record.readings["constraint_effect"].values[:, 3].max() < 1e-6


def random_states(count, seed):
    """Return the worst excess of the box of speeds in random states, inside obstacles and outside limits among them."""
    rng = np.random.default_rng(seed)
    obstacles = {
        "ball": sphere(center=(0.4, 0.0, 0.4), radius=0.2),
        "other": sphere(center=(0.45, 0.0, 0.45), radius=0.2, level=1),
        "low": plane(normal=(0, 0, 1), offset=0.3, links=["hand"]),
        "high": plane(normal=(0, 0, -1), offset=-0.2, links=["hand"]),
    }
    angles = {"upright": dqc.constraints.Angle(direction=(0, 0, -1), at_most=0.5)}
    given = dqc.constraints.Constraints(**around(obstacles), angles=angles, acceleration=10.0, recovery=0.1)
    law = dqc.laws.Proportional(gain=3.0, constraints=given).prepare(ARM, None, 0.01)
    gave = set()
    for _ in range(count):
        q = rng.uniform(ARM.limits.lower - 0.1, ARM.limits.upper + 0.1)
        state = law.initial_state(q)
        law.sent(state, rng.uniform(-1, 1, 7) * ARM.limits.velocity)
        u = law.command(q, dqc.Sample(ARM.fkm(rng.uniform(-1, 1, 7))), state)
        assert np.isfinite(u).all()
        assert (np.abs(u) <= ARM.limits.velocity * (1 + 1e-9)).all()
        names = law.constraints.names  # pyright: ignore[reportOptionalMemberAccess]
        slack = law.report[-len(names) :]
        gave |= {name for name, value in zip(names, slack, strict=True) if value > 0}
    return gave


def test_every_state_has_a_command():
    assert random_states(300, 4) >= {"ball", "other", "low", "high", "upright"}


@pytest.mark.slow
def test_a_hundred_thousand_states_have_a_command():
    random_states(100_000, 5)


def test_a_start_inside_is_refused_and_recovers_if_asked():
    hand = dqc.DualQuaternion(ARM.fkm(HOME)).translation
    ball = sphere(center=tuple(hand + np.array([0.0, 0.03, 0.0])), radius=0.05, links=["hand"])
    goal = dqc.references.SetPoint(ARM.fkm(HOME))
    law = dqc.laws.Proportional(gain=2.0, constraints=dqc.constraints.Constraints(**around({"ball": ball})))
    with pytest.raises(dqc.Error, match="ball: hand: 20 mm deep, 10 mm of distance are asked"):
        dqc.simulate(ARM, goal, law, PLANT, HOME, period=0.01, duration=1.0)
    given = dqc.constraints.Constraints(**around({"ball": ball}), recovery=0.1)
    law = dqc.laws.Proportional(gain=2.0, constraints=given)
    record = dqc.simulate(ARM, goal, law, PLANT, HOME, period=0.01, duration=1.5)
    distance = record.readings["constraint_distance"].values[:, 0]
    assert distance[-1] > 0.0099
    assert np.diff(distance).max() < 0.0011  # m a period: 0.1 m/s


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (around({"x": sphere(center=(1, 0, 0), radius=0.1, links=["hnad"])}), "hand"),
        ({"angles": {"x": dqc.constraints.Angle(direction=(0, 0, 1), at_most=0.0)}}, "at_most: must be ≥"),
        ({"angles": {"x": dqc.constraints.Angle(direction=(0, 0, 0), at_most=1.0)}}, "must not be zero"),
        ({"rate": 200.0}, "rate: must be ≤ 100"),
        ({"acceleration": [1.0]}, "expected 7 numbers"),
        ({"sights": {"x": dqc.constraints.LineOfSight(target="nothing", at_most=0.5)}}, "target: unknown"),
    ],
)
def test_bad_input_is_named(given, words):
    law = dqc.laws.Proportional(gain=1.0, constraints=dqc.constraints.Constraints(**given))
    with pytest.raises(dqc.Error, match=words):
        law.prepare(ARM, None, 0.01)


def test_a_path_lasts_ten_million_periods_at_most(monkeypatch):
    monkeypatch.setattr(
        "dqcontrol.constraints.prepared_constraints._MOST_PERIODS", 1000
    )  # tables of megabytes

    def prepared(lasts):
        moves = dqc.world.Motion(path=[(0.0, 0.0, 0.0, 0.0), (lasts, 0.1, 0.0, 0.0)])
        bodies = {"ball": dqc.world.Body(sphere=0.05, position=(1.0, 0.0, 1.0), moves=moves)}
        given = dqc.constraints.Constraints(world=dqc.World(bodies=bodies), clear_of="all")
        return dqc.laws.Proportional(gain=1.0, constraints=given).prepare(ARM, None, 0.005)

    assert prepared(5.0).constraints is not None
    with pytest.raises(
        dqc.Error, match=r"world: a path .* lasts 5 s; at most 1,000 periods of 0.005 s may be"
    ):
        prepared(5.001)
