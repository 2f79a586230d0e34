"""Arms behind their makers' own clients, each with its double: what tests that they share have to know of them."""

import socket
from dataclasses import dataclass, field
from importlib.util import find_spec

import numpy as np
import pytest
from robot_doubles import double_of, own_address, seconds_to_rest

import dqcontrol as dqc
from dqcontrol.plants import FrankaArm, UniversalRobot, XArm

XARM7 = "example-robot-data:xarm_description/urdf/xarm7.urdf"
TIMEOUT = 0.5  # s: more than a loaded machine keeps this process waiting


@dataclass(frozen=True)
class MakersArm:
    """An arm, and how it is driven in tests."""

    kind: str  # of plant, and the extra that brings its client
    plant: type
    client: str
    double: str
    robot: str
    start: list[float]
    period: float
    fastest_period: float  # of the run of a minute
    window: float  # s from the last command to rest, from 0.5 rad/s
    pressed: dict  # what a double is told when somebody presses the emergency stop
    patient: dict = field(
        default_factory=lambda: {"timeout": 1.0}
    )  # a loaded machine wakes this process late

    def double_of(self, **options):
        return double_of(self.double, q=self.start, **options)

    def started(self, double, start=None, period=None, robot=None, **options):
        plant = self.plant(host=double.host, **self.patient | options)
        start = np.array(self.start if start is None else start)
        return plant.start(dqc.load_robot(robot or self.robot), start, period or self.period, 10, 0)

    def refused(self, double, error, words, **options):
        """What is wrong is said, in a line, and nothing moves."""
        with pytest.raises(error, match=words) as said:
            self.started(double, **options)
        assert "\n" not in str(said.value)
        state = double.until(lambda state: not state["is_driven"])
        assert np.allclose(state["q"], self.start, atol=1e-6) or np.allclose(state["qd"], 0.3)  # as before

    def spec(self, host, duration=2.0, **plant):
        return {
            "name": self.kind, "robot": self.robot, "start": self.start, "period": self.period,
            "reference": {"kind": "circle", "radius": 0.02, "duration": duration},
            "law": {"kind": "proportional-feedforward", "gain": 5.0},
            "supervisor": {"stale_after": 1.0, "ramp": 0.1},
            "plant": {"kind": self.kind, "host": host, **self.patient, **plant},
        }  # fmt: skip

    def seconds_to_rest(self, process, how, seed, **options):
        asked = {"kind": self.plant.__name__, "robot": self.robot, "start": self.start, "timeout": TIMEOUT}
        return seconds_to_rest(process, how, self.double, seed, **asked, **options)

    def skip_without_client(self):
        if find_spec(self.client) is None:
            pytest.skip(f"{self.client} has no wheel here")
        if self.robot == XARM7:
            pytest.importorskip("cmeel", reason="the file of an xArm comes with example-robot-data")
            try:
                socket.create_server((own_address(), 502)).close()
            except PermissionError:
                pytest.skip("an xArm's control box listens on port 502, which is root's here")


UR = MakersArm(
    "ur", UniversalRobot, "rtde_control", "ur_double.py", "ur5", [0.0, -1.2, 1.4, -1.7, -1.5, 0.0], 0.008, 0.002,
    TIMEOUT + 0.002 + 0.5 / 20,  # the watchdog, then at the double's 20 rad/s²
    {"fault": "somebody pressed it"}, {"timeout": 1.0, "lookahead": 0.2},
)  # fmt: skip
FRANKA = MakersArm(
    "franka", FrankaArm, "franky", "franka_double.py", "panda",
    [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], 0.01, 0.005,
    0.02 + 0.5 / 10 + 0.05,  # 20 packets, then at 10 rad/s²; jerk, and filters
    {"mode": 5},
)  # fmt: skip
XARM = MakersArm(
    "xarm", XArm, "xarm", "xarm_double.py", XARM7, [0.0, -0.4, 0.0, 0.9, 0.0, 1.3, 0.0], 0.01, 0.005,
    TIMEOUT + 0.5 / 10 + 2 * 0.004,  # a velocity lasts the timeout; then at 10 rad/s²; cycles
    {"error": 1},
)  # fmt: skip
