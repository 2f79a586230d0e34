"""What the robot is told."""

from dataclasses import dataclass

from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("dqcontrol")
@dataclass(kw_only=True)
class DqcontrolRobotConfig(RobotConfig):
    """An arm in physics.

    Attributes
    ----------
    spec
        Name or file of a robot, which is then simulated by MuJoCo from its most dexterous posture; or the spec of one
        run with its robot, start, period and plant.
    gain
        Of the joints towards the positions that they are sent to, 1/s.
    """

    spec: str = "panda"
    gain: float = 10.0
