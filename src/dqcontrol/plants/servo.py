"""Position servos: lag, gravity sag, delay, encoders, rate and position limits."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from dqcontrol.compile import OK, WRONG_SIZE, kernel
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive, unknown_name
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import PLANT, Array, CompiledPlant, Plant, start_configuration
from dqcontrol.robots.gravity import body_table, gravity_torque
from dqcontrol.robots.limits import Limits
from dqcontrol.robots.robot import Robot

COMMAND_MODES = ("integrated", "measured")

# parameters: head, then rate limit (n), least and largest target (n each), compliance α/K (n), bodies (4n),
# chain (8 (n + 1))
_DT, _DECAY, _MEASURED_MODE, _DELAY, _RESOLUTION, _NOISE, _SAG, _GRAVITY = 0, 1, 2, 3, 4, 5, 6, 7
_HEAD = 10


@kernel(PLANT)
def servo(command, parameters, noise, state, q, measured):
    """Move the target, let the joints follow it, read the encoders."""
    n = q.shape[0]
    if command.shape[0] != n:
        return WRONG_SIZE
    delay = int(parameters[_DELAY])
    rate = parameters[_HEAD : _HEAD + n]
    least, most = parameters[_HEAD + n : _HEAD + 2 * n], parameters[_HEAD + 2 * n : _HEAD + 3 * n]
    compliance = parameters[_HEAD + 3 * n : _HEAD + 4 * n]
    bodies = parameters[_HEAD + 4 * n : _HEAD + 8 * n].reshape(n, 4)
    chain = parameters[_HEAD + 8 * n : _HEAD + 8 * n + 8 * (n + 1)].reshape(n + 1, 8)
    target = state[0:n]
    sag = state[n : 2 * n]
    queue = state[2 * n : 2 * n + n * (delay + 1)]  # newest target first

    for k in range(delay, 0, -1):
        for i in range(n):
            queue[n * k + i] = queue[n * (k - 1) + i]
    for i in range(n):
        move = parameters[_DT] * min(max(command[i], -rate[i]), rate[i])
        wanted = move + (measured[i] if parameters[_MEASURED_MODE] != 0.0 else target[i])
        target[i] = min(max(wanted, least[i]), most[i])
        queue[i] = target[i]
    if parameters[_SAG] != 0.0:
        gravity_torque(chain, bodies, q, parameters[_GRAVITY : _GRAVITY + 3], sag)
    for i in range(n):
        rest = queue[n * delay + i] - compliance[i] * sag[i]
        q[i] = rest + (q[i] - rest) * parameters[_DECAY]
        value = q[i] + parameters[_NOISE] * noise[i]
        if parameters[_RESOLUTION] > 0.0:
            value = parameters[_RESOLUTION] * math.floor(value / parameters[_RESOLUTION] + 0.5)
        measured[i] = value
    return OK


class Servo(Plant, frozen=True, kw_only=True, tag="servo"):
    """Joints with position servos that lag first-order and sag under gravity.

    Each period the target of joint i moves by T uᵢ, starting from where it was (``integrated``) or from the measured
    position (``measured``: what a velocity command through a position interface becomes; gravity then drags the arm
    down at every sample until the law holds it). The joint follows q̇ = (target − s(q) − q)/τ, integrated exactly with
    s held, with the sag s(q) = α K⁻¹ τ_g(q). The arm starts at rest, its target above q0 by s(q0).

    Parameters
    ----------
    command_mode
        ``"integrated"`` or ``"measured"``.
    time_constant
        τ in s.
    sag
        α, a factor on the gravity sag; 0 for none. Needs a robot with inertia.
    stiffness
        K in N·m/rad (N/m for sliding joints): one number, or one a joint.
    delay
        From command to joint, s, a multiple of the period.
    encoder_resolution
        Step of the measured position, rad or m; 0 for none.
    encoder_noise
        Standard deviation of the measured position, rad or m, white.
    rate_limit
        True: targets move no faster than the robot's velocity limits.
    position_limit
        True: targets do not leave the robot's position limits.
    gravity
        m/s² in the base frame.
    """

    command_mode: Literal["integrated", "measured"] = "integrated"
    time_constant: Annotated[float, Meta(gt=0, description="τ, s")] = 0.05
    sag: Annotated[float, Meta(ge=0, description="α, factor on the gravity sag")] = 0.0
    stiffness: Annotated[float | list[float], Meta(description="K, N·m/rad or N/m")] = 500.0
    delay: Annotated[float, Meta(ge=0, description="s")] = 0.0
    encoder_resolution: Annotated[float, Meta(ge=0, description="rad or m")] = 0.0
    encoder_noise: Annotated[float, Meta(ge=0, description="rad or m")] = 0.0
    rate_limit: bool = True
    position_limit: bool = True
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def start(self, robot: Robot, q0: Array, dt: float, steps: int, seed: int) -> CompiledPlant:
        """Return the plant at rest at q0.

        Raises
        ------
        dqcontrol.Error
            If a parameter is out of range, or the robot has no inertia and there is sag.
        """
        n = robot.configuration_size
        q0, dt = start_configuration(robot, q0), as_positive("dt", dt)
        if self.command_mode not in COMMAND_MODES:
            raise unknown_name("plant.command_mode", str(self.command_mode), COMMAND_MODES)
        delay_steps = self._delay_steps(dt)
        stiffness = as_array("plant.stiffness", self.stiffness)
        if stiffness.shape not in ((), (n,)):
            raise ShapeError(f"plant.stiffness: expected one number or {n}, got shape {stiffness.shape}")
        if (stiffness <= 0).any():
            raise ValueRangeError(f"plant.stiffness: must be > 0, got {stiffness.min():g}")
        sag = as_positive("plant.sag", self.sag, zero_allowed=True)
        compliance = np.broadcast_to(sag / stiffness, n)
        sag0 = compliance * robot.gravity_torque(q0, self.gravity) if sag else np.zeros(n)
        target = q0 + sag0
        rate = robot.limits.velocity if self.rate_limit else np.full(n, np.inf)
        ends = robot.limits if self.position_limit else Limits.none(n)
        head = np.zeros(_HEAD)
        head[_DT] = dt
        head[_DECAY] = math.exp(-dt / as_positive("plant.time_constant", self.time_constant))
        head[_MEASURED_MODE] = self.command_mode == "measured"
        head[_DELAY] = delay_steps
        head[_RESOLUTION] = as_positive(
            "plant.encoder_resolution", self.encoder_resolution, zero_allowed=True
        )
        head[_NOISE] = as_positive("plant.encoder_noise", self.encoder_noise, zero_allowed=True)
        head[_SAG] = sag
        head[_GRAVITY : _GRAVITY + 3] = as_array("plant.gravity", self.gravity, (3,))
        bodies = body_table(robot.inertia) if sag and robot.inertia else np.zeros((n, 4))
        parameters = np.concatenate(
            [head, rate, ends.lower, ends.upper, compliance, bodies.ravel(), robot.chain.ravel()]
        )
        state = np.concatenate([target, np.zeros(n), np.tile(target, delay_steps + 1)])
        noise = (
            np.random.default_rng(seed).standard_normal((steps, n))
            if self.encoder_noise
            else np.zeros((steps, n))
        )
        return CompiledPlant(servo, parameters, state, q0, noise)

    def _delay_steps(self, dt: float) -> int:
        """Return the delay in periods."""
        steps = round(as_positive("plant.delay", self.delay, zero_allowed=True) / dt)
        if abs(steps * dt - self.delay) > 1e-9:
            raise ValueRangeError(
                f"plant.delay: must be a multiple of the period {dt:g} s, got {self.delay:g} s"
            )
        return steps

    def linear_model(self, robot: Robot, q0: Array, dt: float) -> LinearModel:
        """Return one joint without sag, encoder and rate limit: its position and its targets, newest first.

        t⁺ = t + T u (``integrated``) or y + T u (``measured``), y⁺ = a y + (1 − a) t⁺ delayed, a = exp(−T/τ).
        """
        delay, decay = self._delay_steps(dt), math.exp(-dt / self.time_constant)
        transition, inputs = np.zeros((delay + 2, delay + 2)), np.zeros((delay + 2, 1))
        transition[1, 0 if self.command_mode == "measured" else 1] = 1.0
        inputs[1] = dt
        for late in range(2, delay + 2):
            transition[late, late - 1] = 1.0
        transition[0] = (1 - decay) * transition[-1]
        transition[0, 0] += decay
        inputs[0] = (1 - decay) * inputs[-1]
        return LinearModel(transition, inputs)
