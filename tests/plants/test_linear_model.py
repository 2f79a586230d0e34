"""The plants' linear models against the plants."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import InterpretedWarning
from dqcontrol.plants import Integrator, MujocoPlant, OwnPlant, Servo

SEED = 20260731
T = 0.01
Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def measured_after(plant, arm, commands):
    """Return the measured positions relative to the start after each command."""
    live = plant.start(arm, Q0, T, len(commands), 0)
    moved = []
    for u in commands:
        live.step(u)
        moved.append(live.measured - Q0)
    return np.array(moved)


def predicted(model, commands):
    """Return the same of a linear model."""
    x, moved = np.zeros(len(model.transition)), []
    for u in commands:
        x = model.transition @ x + model.inputs @ u
        moved.append(x[: model.inputs.shape[1]])
    return np.array(moved)


@pytest.mark.parametrize(
    "plant",
    [
        Integrator(),
        *(
            Servo(command_mode=mode, time_constant=tau, delay=delay * T)
            for mode in ("integrated", "measured")
            for tau in (0.005, 0.05)
            for delay in (0, 1, 2, 5)
        ),
        *(
            Servo(command_mode=mode, bandwidth=30.0, damping_ratio=damping, delay=delay * T)
            for mode in ("integrated", "measured")
            for damping in (0.5, 1.0, 2.0)
            for delay in (0, 1, 1.37)
        ),
    ],
    ids=str,
)
def test_compiled_plants_move_as_their_models(arm, plant):
    print("seed", SEED)
    commands = 0.1 * np.random.default_rng(SEED).normal(size=(80, 7))  # within the velocity limits
    model = plant.linear_model(arm, Q0, T)
    assert model.inputs.shape[1] == 1, "one joint stands for all"
    wanted = np.stack([predicted(model, commands[:, [i]])[:, 0] for i in range(7)], axis=1)
    assert measured_after(plant, arm, commands) == pytest.approx(wanted, abs=1e-13)


@pytest.mark.parametrize("mode", ["integrated", "measured"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"bandwidth": 4.0, "damping_ratio": 0.3, "timestep": 0.002, "viscous_friction": 3.0},
        {"stiffness": [4000.0, 4000, 3000, 3000, 1000, 500, 300], "damping": 40.0},
    ],
    ids=["default", "soft", "stiffness"],
)
def test_physics_moves_as_its_model(arm, mode, options):
    pytest.importorskip("mujoco")
    print("seed", SEED)
    plant = MujocoPlant(command_mode=mode, gravity=(0.0, 0.0, 0.0), **options)
    commands = 1e-4 * np.random.default_rng(SEED).normal(size=(60, 7))
    moved = measured_after(plant, arm, commands)
    wanted = predicted(plant.linear_model(arm, Q0, T), commands)
    assert moved == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max())


def test_a_plant_that_jumps_has_none(arm):
    def relay(command, parameters, noise, state, q, measured):
        for i in range(q.shape[0]):
            q[i] += 1e-3 * np.sign(command[i])
            measured[i] = q[i]

    assert OwnPlant(function=relay).linear_model(arm, Q0, T) is None


def test_a_builtin_is_interpreted_and_says_so(arm):
    with pytest.warns(InterpretedWarning, match="print: does not compile"):
        OwnPlant(function=print).start(arm, np.array(Q0), T, 1, 0)
