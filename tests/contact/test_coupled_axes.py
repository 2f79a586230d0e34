"""The stiffness that a loop bears where what is touched couples its axes, against simulations of pads of springs."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Admittance, Compliance, ForceSensor, WantedWrench, contact_limits
from dqcontrol.contact.limits import _Loop
from dqcontrol.errors import ValueRangeError

ARM = dqc.load_robot("iiwa7")


class Pad:
    """An arm whose end effector gives way along z and about x and y, on springs beside its axis.

    Servos lag unlike each other where the seed is odd.
    """

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.period = float(rng.choice([0.002, 0.004]))
        tau = rng.uniform(0.01, 0.06, 7).tolist() if seed % 2 else float(rng.uniform(0.01, 0.06))
        self.plant = dqc.plants.Servo(time_constant=tau, delay=float(rng.uniform(0, 0.02)))
        self.q = np.array([0, 0.6, 0, -1.6, 0, 0.9, 0]) + rng.uniform(-0.3, 0.3, 7)
        law = dqc.laws.ProportionalFeedforward(gain=float(rng.uniform(0.5, 2)))
        self.law = law.prepare(ARM, None, self.period)
        self.filter = float(rng.choice([0.0, rng.uniform(0.002, 0.01)]))
        self.admittance = Admittance(
            sensor=ForceSensor(filter=self.filter),
            translation=Compliance(damping=float(rng.uniform(100, 400)), stiffness=["rigid", "rigid", 0.0]),
            rotation=Compliance(
                mass=float(rng.choice([0.0, 0.02])),
                damping=(10 ** rng.uniform(-0.5, 0.7, 3)).tolist(),
                stiffness=[0.0, 0.0, "rigid"],
            ),
            force=WantedWrench(z=2.0),
            ramp=0.0,
        )
        middle, count = rng.uniform(-0.05, 0.05, 2), int(rng.choice([1, 2, 4]))
        at = np.column_stack([middle + rng.uniform(-0.04, 0.04, (count, 2)), np.zeros(count)])
        self.at = at
        self.contacts = np.array([[*np.cross(r, [0, 0, 1]), 0, 0, 1] for r in at])

    def predicted(self):
        model = self.plant.linear_model(ARM, self.q, self.period)
        return _Loop(self.admittance, self.law, model, self.q, [0, 1, 5], self.contacts, np.zeros(7))

    def grows(self, stiffness, seconds):
        """Return whether forces that are a little off balance have grown."""
        period, pose = self.period, ARM.fkm(self.q)
        turn, place = algebra.matrix_from_pose(pose)[:3, :3], algebra.translation(pose)
        steps = int(seconds / period)
        plant = self.plant.start(ARM, self.q, period, steps, 0)
        stage, state = self.admittance.start(period), self.law.initial_state(self.q)
        sample, command = np.concatenate([pose, np.zeros(13)]), np.zeros(7)
        count = len(self.contacts)
        way, force, off = np.zeros(count), np.full(count, 1e-3), np.zeros(steps)
        for k in range(steps):
            felt = force if self.filter else -stiffness * way + (1e-3 if k == 0 else 0.0)
            off[k] = np.abs(felt).max()
            if not off[k] < 1e3:
                return True
            wrench = felt @ self.contacts
            moment, push = wrench[:3], wrench[3:] + np.array([0, 0, 2.0])
            shaped = stage.step(ARM.fkm(plant.measured), sample, np.concatenate([push, moment]))
            self.law.step(plant.measured, shaped, 0, state, command)
            plant.step(command)
            now = ARM.fkm(plant.q)
            turned = turn.T @ algebra.matrix_from_pose(now)[:3, :3]
            tilt = 0.5 * np.array([(turned - turned.T)[i] for i in ((2, 1), (0, 2), (1, 0))])
            moved = np.concatenate([tilt, turn.T @ (algebra.translation(now) - place)])
            after = self.contacts @ moved
            for i in range(8):  # way straight between samples
                middle = way + (after - way) * (i + 0.5) / 8
                if self.filter:
                    force = force + (-stiffness * middle - force) * -np.expm1(-period / 8 / self.filter)
            way = after
        early, late = off[steps // 5 : 2 * steps // 5].max(), off[-steps // 5 :].max()
        return late > early


def bracket(seed, below, above):
    """Return whether it grows below and above the predicted limit; None where that would take too long."""
    pad = Pad(seed)
    loop = pad.predicted()
    limit = loop.limit()
    if not 50 < limit < 1e6:
        return None
    growth = np.log(loop.radius(above * limit)) / pad.period
    seconds = 5.0 / growth + 1.0
    if not seconds < 15:
        return None
    return pad.grows(below * limit, seconds), pad.grows(above * limit, seconds)


SLOW = [pytest.param(range(first, first + 4), 1, marks=pytest.mark.slow) for first in range(0, 40, 4)]


@pytest.mark.parametrize(("seeds", "least"), [((5, 10), 2), *SLOW])
def test_coupled_axes_against_the_onset_in_simulation(seeds, least):
    found = {seed: bracket(seed, 0.95, 1.05) for seed in seeds}
    judged = {seed: each for seed, each in found.items() if each is not None}
    assert len(judged) >= least
    assert all(each == (False, True) for each in judged.values()), judged


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))])
def test_the_worst_point_alone_is_on_the_safe_side(seed):
    """One point is told as it is; several at once bear more together than the worst of them."""
    pad = Pad(seed)
    together = pad.predicted().limit() * len(pad.at)
    limits = contact_limits(pad.admittance, pad.law, pad.plant, pad.q, at=pad.at)
    apart = contact_limits(pad.admittance, pad.law, pad.plant, pad.q)
    if len(pad.at) == 1:
        assert limits.stiffness == pytest.approx(min(together, apart.stiffness), rel=1e-3)
    assert limits.stiffness <= 1.001 * together
    assert limits.stiffness <= apart.stiffness


def test_points_need_a_force():
    pad = Pad(0)
    free = Admittance(translation=Compliance(damping=100.0))
    with pytest.raises(ValueRangeError, match="at: is touched along the wanted force"):
        contact_limits(free, pad.law, pad.plant, pad.q, at=[[0.01, 0, 0]])
