"""A double of LeRobot: its modules as the driver asks for them, with an SO-101 follower whose servos are simulated.

Degrees, no bus. A servo goes towards its goal at 90 deg/s at most, in the time that passes. Tests with LeRobot's own
library are in tests/lerobot.
"""

import sys
import time
import types
from dataclasses import dataclass

import numpy as np

JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
SPEED = 90.0  # deg/s


@dataclass
class Config:
    port: str = ""
    id: str | None = None
    use_degrees: bool = True
    disable_torque_on_disconnect: bool = True


class Follower:
    """The arm; the last one made is ``Follower.last``."""

    last = None
    start, calibrated, there = [0.0] * 6, True, True

    def __init__(self, config):
        self.config, self.is_connected, self.sent, self.fails = config, False, [], ""
        self.q = np.array(self.start, dtype=float)
        self.goal, self.then = self.q.copy(), time.monotonic()
        self.drift = 0.0
        Follower.last = self

    action_features = {f"{name}.pos": float for name in JOINTS}

    @property
    def is_calibrated(self):
        return self.calibrated

    def connect(self, calibrate=True):
        assert not calibrate  # a program asks nothing of people
        if not self.there:
            raise ConnectionError(f"Failed to open port '{self.config.port}'")
        self.is_connected = True

    def disconnect(self):
        self.is_connected = False

    def pass_time(self):
        if self.fails:
            raise ConnectionError(self.fails)
        now = time.monotonic()
        step = SPEED * (now - self.then)
        self.q += np.clip(self.goal - self.q, -step, step) + self.drift * (now - self.then)
        self.then = now

    def get_observation(self):
        self.pass_time()
        return dict(zip(self.action_features, self.q.tolist(), strict=True))

    def send_action(self, action):
        self.pass_time()
        self.sent.append(action)
        for key, value in action.items():
            self.goal[list(self.action_features).index(key)] = value
        return action


class RobotConfig:
    """The registry of LeRobot's configurations."""

    @staticmethod
    def get_known_choices():
        return {"so101_follower": Config}


def install(monkeypatch):
    """Put the double in LeRobot's place."""
    robots = types.ModuleType("lerobot.robots")
    robots.RobotConfig, robots.make_robot_from_config, robots.__path__ = RobotConfig, Follower, []
    utilities = types.ModuleType("lerobot.utils.import_utils")
    utilities.register_third_party_plugins = lambda: None
    for name in ("lerobot", "lerobot.utils"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, "lerobot.robots", robots)
    monkeypatch.setitem(sys.modules, "lerobot.utils.import_utils", utilities)
    for name, value in (("last", None), ("start", [0.0] * 6), ("calibrated", True), ("there", True)):
        monkeypatch.setattr(Follower, name, value)
    return Follower
