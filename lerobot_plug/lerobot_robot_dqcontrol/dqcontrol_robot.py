"""The robot: joint positions in, joint positions out, physics in between."""

import time
from typing import Any

import numpy as np
from lerobot.robots import Robot

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.experiments.driven import is_spec, prepare_driven, spec_of_robot
from lerobot_robot_dqcontrol.config_dqcontrol import DqcontrolRobotConfig

_LONGEST = (
    0.5  # s that are caught up between two actions; a program that stood longer goes on from where the arm is
)


class DqcontrolRobot(Robot):
    """An arm of dqcontrol in MuJoCo.

    Actions and observations are ``JOINT.pos``, rad or m. Between two actions as much time passes for the arm as on the
    clock. Joints go towards their positions by a velocity of ``gain`` times what is left, within their limits.
    """

    config_class = DqcontrolRobotConfig
    name = "dqcontrol"

    def __init__(self, config: DqcontrolRobotConfig) -> None:
        super().__init__(config)
        source = (
            config.spec
            if is_spec(config.spec)
            else spec_of_robot(config.spec) | {"plant": {"kind": "mujoco"}}
        )
        setting = prepare_driven(source)
        (case,) = setting.cases
        self._start = case.scene.start
        self._model = case.scene.robot
        self._period = setting.spec.period
        self._prepared = lambda: case.plant.start(
            self._model, self._start, self._period, 1, setting.spec.seed
        )
        if self._model.joint_names != self._model.input_names:
            raise ShapeError(f"spec: {self._model.name} is no arm: its inputs are no joints")
        self._gain = config.gain
        self._plant: Any = None
        self._goal = np.array(self._start)
        self._then = 0.0

    @property
    def observation_features(self) -> dict[str, type]:
        """``JOINT.pos`` of each joint."""
        return {f"{name}.pos": float for name in self._model.joint_names}

    action_features = observation_features

    @property
    def is_connected(self) -> bool:
        """Whether it is simulated."""
        return self._plant is not None

    @property
    def is_calibrated(self) -> bool:
        """Always."""
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Put the arm at rest at its start."""
        self._plant, self._goal = self._prepared(), np.array(self._start)
        self._then = time.monotonic()

    def calibrate(self) -> None:
        """Do nothing: there is nothing to calibrate."""

    def configure(self) -> None:
        """Do nothing: there is nothing to set."""

    def get_observation(self) -> dict[str, float]:
        """Return where the joints are."""
        self._pass_time()
        return dict(zip(self.observation_features, map(float, self._plant.measured), strict=True))

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Send the joints to positions; returns those within their limits that they go to.

        Raises
        ------
        ValueRangeError
            If a joint is missing or none of this arm's, or a number is not finite.
        """
        self._pass_time()
        names, limits = list(self.action_features), self._model.limits
        if set(action) != set(names):
            raise ValueRangeError(f"action: expected {', '.join(names)}; got {', '.join(action) or 'none'}")
        goal = np.array([float(action[name]) for name in names])
        if not np.isfinite(goal).all():
            raise ValueRangeError(f"action: must be finite, got {goal}")
        self._goal = np.clip(goal, limits.lower, limits.upper)
        return dict(zip(names, map(float, self._goal), strict=True))

    def disconnect(self) -> None:
        """End the simulation."""
        self._plant = None

    def _pass_time(self) -> None:
        if self._plant is None:
            raise RuntimeError("dqcontrol: the robot is not connected")
        now = time.monotonic()
        self._then = max(self._then, now - _LONGEST)
        most = self._model.limits.velocity
        while self._then + self._period <= now:
            self._then += self._period
            left = self._gain * (self._goal - self._plant.measured)
            self._plant.step(np.clip(left, -most, most))
