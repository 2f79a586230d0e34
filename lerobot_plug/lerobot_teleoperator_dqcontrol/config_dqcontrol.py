"""What the teleoperator is told."""

from dataclasses import dataclass

from lerobot.teleoperators import TeleoperatorConfig


@TeleoperatorConfig.register_subclass("dqcontrol")
@dataclass(kw_only=True)
class DqcontrolTeleoperatorConfig(TeleoperatorConfig):
    """A leader arm.

    Attributes
    ----------
    spec
        Spec of one run: its law leads the arm along its reference, with its limits, constraints and supervisor; or name
        or file of a robot, whose end effector stays where it is until ``teleoperator.live`` gets another target.
    """

    spec: str = "panda"
