"""The stiffness that a loop bears, against simulations of it that touch springs."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Admittance, Compliance, ForceSensor, WantedWrench, contact_limits
from dqcontrol.contact.limits import _loop_of

ARM = dqc.load_robot("iiwa7")
PUSH = 2.0  # N


class Loop:
    """An arm on position servos with an admittance that pushes on a spring along the hand's z axis."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.period = float(rng.choice([0.002, 0.004, 0.008]))
        self.filter = float(rng.choice([0.0, rng.uniform(0.001, 0.02)]))
        tau = rng.uniform(0.01, 0.06, 7) if seed % 2 else rng.uniform(0.01, 0.06)
        self.plant = dqc.plants.Servo(
            time_constant=tau.tolist() if seed % 2 else float(tau), delay=float(rng.uniform(0, 0.025))
        )
        mass = float(rng.choice([0.0, rng.uniform(0.2, 5)]))
        stiffness = float(rng.choice([0.0, rng.uniform(10, 500)]))
        kind = rng.choice(3)
        law = (
            dqc.laws.ProportionalFeedforward(gain=1.0),
            dqc.laws.ProportionalFeedforward(gain=3.0),
            dqc.laws.Proportional(gain=2.0),
        )[kind]
        self.q = np.array([0, 0.6, 0, -1.6, 0, 0.9, 0]) + rng.uniform(-0.3, 0.3, 7)
        self.law = law.prepare(ARM, None, self.period)
        self.mass = float(
            rng.choice([0.0, 0.0, 10 ** rng.uniform(-0.5, 1.5)])
        )  # kg of a loose part, or a wall
        self.admittance = Admittance(
            sensor=ForceSensor(filter=self.filter),
            translation=Compliance(
                mass=mass, damping=float(rng.uniform(50, 500)), stiffness=["rigid", "rigid", stiffness]
            ),
            force=WantedWrench(z=PUSH),
            ramp=0.0,
        )

    def grows(self, stiffness, seconds):
        """Return whether a force that is 0.1 % off in balance has grown after 300 lags or so."""
        period, pose = self.period, ARM.fkm(self.q)
        normal = algebra.matrix_from_pose(pose)[:3, 2]
        steps = int(seconds / period)
        plant = self.plant.start(ARM, self.q, period, steps, 0)
        stage, state = self.admittance.start(period), self.law.initial_state(self.q)
        sample, command = np.concatenate([pose, np.zeros(13)]), np.zeros(7)
        rest = -PUSH / stiffness  # of the hand where the force is as wanted
        place, speed, force = 0.0, 0.0, PUSH * 1.001
        way, felt, substeps = 0.0, np.zeros(steps), 8
        h = period / substeps
        for k in range(steps):
            felt[k] = force if self.filter else stiffness * (place - way) + PUSH + (0.002 if k == 0 else 0.0)
            shaped = stage.step(ARM.fkm(plant.measured), sample, np.array([0, 0, felt[k], 0, 0, 0]))
            self.law.step(plant.measured, shaped, 0, state, command)
            plant.step(command)
            after = normal @ (algebra.translation(ARM.fkm(plant.q)) - algebra.translation(pose))
            for i in range(substeps):  # midpoint rule, way straight between samples
                middle = way + (after - way) * (i + 0.5) / substeps
                true = stiffness * (place - middle) + PUSH
                if self.mass:
                    push = -(true - PUSH) / self.mass
                    speed_middle = speed + 0.5 * h * push
                    place_middle = place + 0.5 * h * speed
                    speed += h * -stiffness * (place_middle - middle) / self.mass
                    place += h * speed_middle
                    true = stiffness * (0.5 * (place_middle + place_middle) - middle) + PUSH
                if self.filter:
                    force += (true - force) * -np.expm1(-h / self.filter)
            way = after
            if not np.isfinite(felt[k]) or abs(felt[k] - PUSH) > 100 * PUSH:
                return True
        assert rest < 0
        off = np.abs(felt - PUSH)
        early, late = off[steps // 5 : 2 * steps // 5].max(), off[-steps // 5 :].max()
        return late > early


def check(seed):
    """Return whether it grows 5 % below the predicted limit and 5 % above it; None where that would take too long."""
    loop = Loop(seed)
    model = loop.plant.linear_model(ARM, loop.q, loop.period)
    axis = _loop_of(loop.admittance, loop.law, model, loop.q, 5, np.zeros(7))
    limit = axis.limit(loop.mass)
    if not 50 < limit < 1e6:
        return None
    growth = np.log(axis.radius(1.05 * limit, loop.mass)) / loop.period
    seconds = 5.0 / growth + 1.0
    if seconds > 60:
        return None
    return loop.grows(0.95 * limit, seconds), loop.grows(1.05 * limit, seconds)


@pytest.mark.parametrize(
    ("seeds", "least"),
    [((3, 4, 8, 10, 12, 22), 6), pytest.param(range(120), 50, marks=pytest.mark.slow)],
)
def test_predicted_limit_against_the_onset_in_simulation(seeds, least):
    """Quiet 5 % below, growing 5 % above: lags alike and not, filters, masses, walls and loose parts."""
    found = {seed: check(seed) for seed in seeds}
    judged = {seed: each for seed, each in found.items() if each is not None}
    assert len(judged) >= least
    assert all(each == (False, True) for each in judged.values()), judged


@pytest.mark.parametrize(
    ("bandwidth", "damping"),
    [
        (10.0, 150.0),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in ((10.0, 60.0), (30.0, 60.0), (30.0, 150.0))
        ),
    ],
)
def test_servos_that_give_way_in_physics(bandwidth, damping):
    """Quiet 20 % below, swinging 25 % above, at up to 2.3 times what a loop of stiff joints would bear."""
    pytest.importorskip("mujoco")
    arm = dqc.SerialArm.join([ARM, algebra.pose([1, 0, 0, 0], [0, 0, 0.1])])
    q, period = np.array([0, 0.6, 0, -1.6, 0, 0.9, 0]), 0.004
    pose = arm.fkm(q)
    x, y, z = algebra.translation(pose)
    push = Admittance(
        axes="base",
        translation=Compliance(damping=damping, stiffness=["rigid", "rigid", 0.0]),
        force=WantedWrench(z=4.0),
        sensor=ForceSensor(filter=0.005),
    )
    pen = dqc.plants.Wrist(filter=0.005, length=0.1, radius=0.004)
    plant = dqc.plants.MujocoPlant(bandwidth=bandwidth, timestep=2.5e-4, wrist=pen)
    law = dqc.laws.ProportionalFeedforward(gain=1.0)
    limit = contact_limits(push, law.prepare(arm, None, period), plant, q).stiffness
    spread = []
    for share in (0.8, 1.25):
        board = dqc.world.Body(box=(0.4, 0.4, 0.04), position=(x, y, z - 0.0215), stiffness=share * limit)
        touching = plant.in_world(dqc.World(bodies={"board": board}))
        pressing = dqc.laws.ProportionalFeedforward(gain=1.0, contact=push)
        record = dqc.simulate(arm, dqc.references.SetPoint(pose), pressing, touching, q, period, 10.0)
        spread.append(record.readings["touch_force"].values[-500:, 2].std())
    assert spread[0] < 0.01
    assert spread[1] > 1.0
