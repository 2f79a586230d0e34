"""The teleoperator: a leader arm, simulated, whose joint positions are the actions."""

import time
from typing import Any

from lerobot.teleoperators import Teleoperator

from dqcontrol.experiments.driven import is_spec, live_of, prepare_driven
from dqcontrol.loop.live import Live
from lerobot_teleoperator_dqcontrol.config_dqcontrol import DqcontrolTeleoperatorConfig

_LONGEST = 0.5  # s that are caught up between two actions


class DqcontrolTeleoperator(Teleoperator):
    """A leader arm that a law drives: along the reference of a spec, or to targets that a program gives ``live``.

    Attributes
    ----------
    live
        The leader; ``live.target = pose`` leads it elsewhere.
    """

    config_class = DqcontrolTeleoperatorConfig
    name = "dqcontrol"

    def __init__(self, config: DqcontrolTeleoperatorConfig) -> None:
        super().__init__(config)
        self._setting = prepare_driven(config.spec)
        (self._case,) = self._setting.cases
        self._leads = is_spec(config.spec)
        self.live: Live = live_of(self._setting)
        self._then: float | None = None

    @property
    def action_features(self) -> dict[str, type]:
        """``JOINT.pos`` of each joint, rad or m."""
        return {f"{name}.pos": float for name in self.live.robot.joint_names}

    @property
    def feedback_features(self) -> dict[str, type]:
        """None."""
        return {}

    @property
    def is_connected(self) -> bool:
        """Whether it is led."""
        return self._then is not None

    @property
    def is_calibrated(self) -> bool:
        """Always."""
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Begin to lead."""
        if self._leads:
            self.live.follow(self._case.scene.reference)
        self._then = time.monotonic()

    def calibrate(self) -> None:
        """Do nothing: there is nothing to calibrate."""

    def configure(self) -> None:
        """Do nothing: there is nothing to set."""

    def get_action(self) -> dict[str, float]:
        """Return where the leader's joints are now."""
        if self._then is None:
            raise RuntimeError("dqcontrol: the teleoperator is not connected")
        now, period = time.monotonic(), self.live.period
        self._then = max(self._then, now - _LONGEST)
        while self._then + period <= now:
            self._then += period
            self.live.step()
        return dict(zip(self.action_features, map(float, self.live.plant.measured), strict=True))

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Take no notice."""

    def disconnect(self) -> None:
        """Stop leading."""
        self._then = None
