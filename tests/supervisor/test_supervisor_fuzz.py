"""Anything is fed to supervisors of random robots, with limits that move: nothing leaves beyond a bound unsaid."""

import numba
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.compiled.intrinsics import caller
from dqcontrol.robots.kinematics import kinematics_kernels as kernels
from dqcontrol.supervisor import Supervisor, WorkspaceBox, supervisor_layout as layout
from dqcontrol.supervisor.interventions import IMPOSSIBLE, STOPS, stop_category
from dqcontrol.supervisor.supervisor_layout import END, FINISH, GO, RESET, STOP, SUPERVISOR
from dqcontrol.supervisor.supervisor_step import supervise

SEED = 20261122
HONEST, FROZEN, JUMPING, ANYTHING = range(4)  # what is measured
_call = caller(SUPERVISOR)


@numba.njit
def drive(step, kinematics, memory, q, moved, state, wanted, moments, measured, noise, out):
    """Step through rows of events; write position command, rate, code and whether it rests of each step."""
    n, m = q.shape[0], wanted.shape[1]
    base = layout.MEMORY + n
    nothing = np.zeros(0)
    for k in range(wanted.shape[0]):
        if measured[k] != FROZEN:
            for i in range(m):
                q[moved[i]] = state[base + i] + noise[k, i] * (1.0 if measured[k] == HONEST else 1e3)
        if measured[k] == ANYTHING:
            for i in range(n):
                q[i] = noise[k, i % m] * 1e6
        status = _call(
            step, kinematics, memory, moments[k], q, wanted[k], nothing, nothing, state, out[k, 0:m]
        )
        if status != 0 and status != layout.AT_REST:
            return status
        for i in range(m):
            out[k, m + i], out[k, 2 * m + i] = state[base + i], state[base + m + i]
        out[k, 3 * m], out[k, 3 * m + 1] = state[layout.NOW], (1.0 if status == layout.AT_REST else 0.0)
        out[k, 3 * m + 2] = 1.0 if state[layout.MODE] == layout.STOPPED else 0.0
        for i in range(n):  # what is not a number is measured once
            if not abs(q[i]) < 1e5:
                q[i] = state[layout.MEMORY + i]
    return 0


def random_arm(rng):
    """Return an arm of 1 to 20 joints with random links and limits, some of them without."""
    n = int(rng.integers(1, 21))
    return dqc.SerialArm.from_dh(
        np.zeros(n),
        rng.uniform(-0.3, 0.3, n),
        rng.uniform(-0.3, 0.3, n),
        rng.uniform(-np.pi, np.pi, n),
        name="any",
    )


def wild(rng, shape, scale):
    """Return numbers of all sizes, with jumps, NaN and infinities among them."""
    values = scale * rng.standard_normal(shape) * 10.0 ** rng.choice([-3, 0, 0, 0, 3], shape)
    strange = rng.random(shape) < 2e-4
    kinds = np.array([np.nan, np.inf, -np.inf, 1e308, -1e308, 0.0])
    values[strange] = kinds[rng.integers(0, len(kinds), strange.sum())]
    return values


class Episode:
    """One supervisor of one robot, from its start to its rest."""

    def __init__(self, rng, robot):
        self.rng, self.robot = rng, robot
        self.n, self.m = robot.configuration_size, robot.input_size
        self.period = period = (
            float(10 ** rng.uniform(-9, -1)) if rng.random() < 0.5 else float(10 ** rng.uniform(-3, -1))
        )
        acceleration = (
            10 ** rng.uniform(-1, 2, self.m) if rng.random() < 0.7 else float(10 ** rng.uniform(-1, 4))
        )
        self.speed = speed = 10 ** rng.uniform(-2, 1)
        options = {"acceleration": acceleration if np.isscalar(acceleration) else acceleration.tolist()}
        largest = np.max(acceleration)
        if rng.random() < 0.3:
            self.jerk = options["jerk"] = float(2 * largest / (period * rng.integers(1, 40)))
        else:
            self.jerk = np.inf
        singular = float(rng.choice([0.0, 0.0, 0.05, 0.2]))
        q = rng.uniform(-1, 1, self.n)
        hand = algebra.translation(robot.fkm(q))
        reach = speed / (np.min(acceleration) * period)  # periods of braking
        self.box = self.hand_speed = None
        if reach < 60 and rng.random() < 0.4 and not len(robot.drives):
            self.box = WorkspaceBox(
                lower=tuple(hand - rng.uniform(0.02, 0.5, 3)), upper=tuple(hand + rng.uniform(0.02, 0.5, 3))
            )
        if reach < 60 and rng.random() < 0.2:
            self.hand_speed = float(10 ** rng.uniform(-2, 0.5))
        self.ramp = float(rng.choice([0.0, 0.05])) if period > 1e-4 else 0.0
        self.supervisor = Supervisor(
            velocity=float(speed), slow_below=singular, hold_below=0.4 * singular, ramp=self.ramp,
            tracking_error=float(rng.choice([0.05, 0.3, 1e6])), workspace=self.box, hand_speed=self.hand_speed,
            overspeed=float(rng.choice([1.5, 1e9])), jump=float(rng.choice([0.05, 1e9])), **options,
        ).prepare(robot, period, rng.choice(["integrated", "measured"]))  # fmt: skip
        self.bounds, self.moved = self.supervisor.bounds, robot.input_coordinates
        self.acceleration, self.joints = self.bounds.acceleration.copy(), self.bounds.is_joint != 0
        self.move_limits(q[self.moved], first=True)
        self.state, self.q = self.supervisor.start(q), q.copy()
        self.before, self.rates = self.supervisor.position(self.state).copy(), np.zeros((2, self.m))
        self.steps = self.moving = self.impossible = self.stops = 0

    def move_limits(self, p, *, first=False):
        """Set random limits; those of the start leave the robot inside, or outside by what it tolerates."""
        rng, bounds = self.rng, self.bounds
        least = 0.0 if first or rng.random() < 0.8 else -0.04
        lower, upper = p - rng.uniform(least, 1.5, self.m), p + rng.uniform(least, 1.5, self.m)
        if first and rng.random() < 0.2:
            lower += np.where(rng.random(self.m) < 0.3, p - lower + 0.0099, 0.0)
        lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
        without = (rng.random(self.m) < 0.1) | ~self.joints
        bounds.lower[:], bounds.upper[:] = np.where(without, -np.inf, lower), np.where(without, np.inf, upper)
        bounds.velocity[:] = rng.choice([0.0, 0.05, 0.3, 1.0, 1.0]) * 10 ** rng.uniform(-2, 1, self.m)

    def events(self, count):
        """Return rows of anything."""
        rng = self.rng
        hold = rng.integers(1, 60)
        wanted = wild(rng, (count, self.m), rng.choice([0.1, 1.0, 30.0]))
        wanted = np.repeat(wanted[::hold], hold, axis=0)[:count]
        p = (
            np.array([0.957, 0.0, 0.002, 0.04, 0.001])
            if self.ramp
            else np.array([0.957, 0.0, 0.003, 0.04, 0.0])
        )
        requests = rng.choice([GO, GO, STOP, RESET, END], count, p=p)
        kinds = [0.0, self.period, 5 * self.period, np.nan, np.inf, -1.0]
        ages = rng.choice(kinds, count, p=[0.9, 0.088, 0.003, 0.003, 0.003, 0.003])
        spans = [self.period, 1.4 * self.period, 0.1 * self.period, 3.0, np.nan, -1.0, np.inf]
        elapsed = rng.choice(spans, count, p=[0.9, 0.0492, 0.0492, 0.0004, 0.0004, 0.0004, 0.0004])
        measured = np.full(count, HONEST)
        for kind, share in ((FROZEN, 0.3), (JUMPING, 0.2), (ANYTHING, 0.1)):
            if rng.random() < share:
                first = rng.integers(0, count)
                measured[first : first + rng.integers(1, 100)] = kind
        return wanted, ages, elapsed, requests, measured, self.noise(count)

    def noise(self, count):
        """Return how far measured joints are from where they were told to be: a little, but for rare spikes."""
        noise = min(1e-4, 0.05 * self.speed * self.period) * self.rng.standard_normal((count, self.m))
        return np.where(self.rng.random((count, 1)) < 1e-3, wild(self.rng, (count, self.m), 0.1), noise)

    def run(self, wanted, ages, elapsed, requests, measured, noise):
        """Step through events, and look at all that leaves."""
        m, count = self.m, len(wanted)
        out = np.zeros((count, 3 * m + 3))
        moments = layout.moment_layout.pack(age=ages, elapsed=elapsed, request=requests, known=0.0, still=0.0)
        status = drive(
            supervise.pointer, kernels.twist_kinematics.pointer, self.supervisor.memory, self.q, self.moved,
            self.state, np.ascontiguousarray(wanted), moments, measured, noise, out,
        )  # fmt: skip
        assert status == 0
        inputs, positions, rates = out[:, :m], out[:, m : 2 * m], out[:, 2 * m : 3 * m]
        codes, rests, stopped = out[:, 3 * m].astype(np.int64), out[:, 3 * m + 1] != 0, out[:, 3 * m + 2] != 0
        said = ((codes & IMPOSSIBLE) != 0)[:, None]
        assert np.isfinite(out).all()
        slack = 1e-9 * np.maximum(1.0, np.abs(positions))
        inside = (self.bounds.lower - slack <= positions) & (positions <= self.bounds.upper + slack)
        assert (inside | said | ~self.joints).all(), "position"
        assert ((np.abs(rates) <= self.bounds.velocity * (1 + 2e-9)) | said).all(), "velocity"
        for row in self.robot.drives:
            first = int(row[0])
            rim = np.abs(rates[:, first]) + row[3] * np.abs(rates[:, first + 1])
            assert ((rim <= self.bounds.velocity[first] * (1 + 2e-9)) | said[:, 0]).all(), "rim"
        every = np.vstack([self.rates, rates])
        change, bend = np.diff(every[1:], axis=0), np.diff(every, n=2, axis=0)
        rounding = 1e-9 * np.maximum(1e-3, np.abs(rates))
        assert (np.abs(change) <= self.acceleration * self.period * (1 + 1e-9) + rounding).all(), (
            "acceleration"
        )
        assert (np.abs(bend) <= self.jerk * self.period**2 * (1 + 1e-9) + 2 * rounding).all(), "jerk"
        path = np.vstack([self.before, positions])
        assert (
            np.abs(np.diff(path, axis=0) - self.period * rates)[:, self.joints] <= slack[:, self.joints]
        ).all()
        if (self.box or self.hand_speed) and self.joints.all():
            hands = algebra.translation(self.robot.fkm(path))
            if self.box:
                within = (hands >= np.array(self.box.lower) - 1e-9) & (
                    hands <= np.array(self.box.upper) + 1e-9
                )
                assert (within[1:] | said).all(), "box"
            if self.hand_speed:
                speeds = np.linalg.norm(np.diff(hands, axis=0), axis=1)
                assert (
                    (speeds <= 1.1 * self.hand_speed * self.period * (1 + 1e-6) + 1e-9) | said[:, 0]
                ).all(), "hand"
        assert ((codes[stopped] & STOPS) != 0).all(), "a stop without a name"
        assert all(stop_category(code) in (1, 2) for code in np.unique(codes[stopped]))
        assert not inputs[rests & (self.bounds.head[layout.FROM_MEASURED] == 0)].any(), (
            "at rest, and told to move"
        )
        self.before, self.rates = positions[-1].copy(), every[-2:].copy()
        self.steps, self.moving = self.steps + count, self.moving + int((rates != 0).any(axis=1).sum())
        self.impossible += int(said.sum())
        self.stops += int((np.diff(stopped.astype(int)) == 1).sum())
        return bool(rests[-1])

    def come_to_rest(self):
        """End in one of the ways, and see that it rests."""
        request = self.rng.choice([STOP, FINISH, END]) if self.ramp else self.rng.choice([STOP, FINISH])
        rate = np.abs(layout.state_layout(self.state, self.n, self.m).rate)
        if request == END:  # which may become faster before it slows down
            rate = rate + np.minimum(self.bounds.velocity, self.acceleration * self.ramp)
        count = int(
            (rate / (self.acceleration * self.period)).max() + self.window + 2 * self.ramp / self.period + 20
        )
        wanted, ages, elapsed, _, measured, noise = self.events(count)
        ages[:], elapsed[:], measured[:] = 0.0, self.period, HONEST
        assert self.run(wanted, ages, elapsed, np.full(count, request), measured, np.zeros_like(noise)), (
            "ends in motion"
        )

    @property
    def window(self):
        return int(self.bounds.head[layout.WINDOW])


def fuzz(seed, steps, robots):
    """Run episodes until so many steps are done; return what was counted."""
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    total = np.zeros(4, dtype=int)
    while total[0] < steps:
        episode = Episode(rng, robots(rng))
        for _ in range(rng.integers(1, 5)):
            episode.run(*episode.events(300))
            if rng.random() < 0.4:
                episode.move_limits(episode.before)
        episode.come_to_rest()
        total += episode.steps, episode.moving, episode.impossible, episode.stops
    print("steps {}, moving {}, impossible bounds said {}, stops {}".format(*total))
    return total


def test_nothing_leaves_beyond_a_bound_and_all_ends_at_rest():
    steps, moving, impossible, stops = fuzz(SEED, 100_000, random_arm)
    assert moving > 0.1 * steps, "most stand still: the test would see little"
    assert impossible
    assert stops > 50


def test_nothing_leaves_beyond_a_bound_of_a_driving_arm():
    arm = dqc.load_robot("iiwa7")
    driving = dqc.WholeBody([dqc.DifferentialDrive(wheel_radius=0.04, half_track=0.13), arm])
    steps, moving, _, _ = fuzz(SEED + 1, 20_000, lambda rng: driving)
    assert moving > 0.1 * steps


@pytest.mark.slow
def test_nothing_leaves_beyond_a_bound_in_ten_million_steps():
    steps, moving, _, _ = fuzz(SEED + 2, 10_000_000, random_arm)
    assert moving > 0.1 * steps
