"""Any arm of LeRobot, by LeRobot's own robot objects."""

from __future__ import annotations

import pkgutil
from contextlib import suppress
from importlib import import_module
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.plants.drivers.driver import Driver, Link, client
from dqcontrol.robots.robot import Robot

_LEROBOT = "lerobot (Python 3.12 or newer)"
_ENDING = ".pos"  # of a joint's position in LeRobot's observations and actions


class LeRobotArm(Driver, frozen=True, kw_only=True, tag="lerobot"):
    """An arm that LeRobot drives: SO-101, ALOHA's arms, or one of a plug, by the name of its type.

    Each period one observation is read and one action sent: positions of the joints, ``JOINT.pos``. A gripper and
    whatever else the robot has stay as they are. If this process dies the servos hold the last position. At the end
    the arm is held too, unless its ``disable_torque_on_disconnect`` says that it is to fall.

    Parameters
    ----------
    robot
        ``type``, and the settings of LeRobot's configuration of such a robot, as ``port`` and ``id``.
    joints
        What LeRobot calls the joints, in the order of the robot's; its names if omitted.
    units
        Of LeRobot's positions: ``deg`` of its own robots, ``rad`` of plugs that say so.

    Raises
    ------
    MissingExtraError
        When started, if LeRobot is not installed.

    Examples
    --------
    >>> LeRobotArm(robot={"type": "so101_follower", "port": "/dev/ttyACM0", "id": "blue"}).address
    "LeRobot's so101_follower at /dev/ttyACM0"
    """

    robot: Annotated[dict[str, Any], Meta(min_length=1, description="type, and what LeRobot takes beside it")]
    joints: Annotated[list[str], Meta(min_length=1)] | None = None
    units: Literal["deg", "rad"] = "deg"

    @property
    def address(self) -> str:
        """What the robot is called in messages."""
        where = self.robot.get("port") or self.robot.get("id")
        return f"LeRobot's {self.robot.get('type')}" + (f" at {where}" if where else "")

    def open(self, robot: Robot, period: float) -> Link:
        """Connect to the robot so that its state can be read; see `Driver.open`."""
        if "type" not in self.robot:
            raise ValueRangeError("plant.robot: needs 'type', as so101_follower")
        names = list(robot.joint_names if self.joints is None else self.joints)
        if len(names) != robot.configuration_size:
            raise ShapeError(f"plant.joints: expected {robot.configuration_size} names, got {len(names)}")
        return _LeRobot(self, names)


class _LeRobot(Link):
    def __init__(self, plant: LeRobotArm, joints: list[str]) -> None:
        kind = _config_class(str(plant.robot["type"]))
        settings = {key: value for key, value in plant.robot.items() if key != "type"}
        if "disable_torque_on_disconnect" in kind.__dataclass_fields__:
            settings = {"disable_torque_on_disconnect": False, **settings}
        config = kind(**settings)
        if plant.units == "deg" and not getattr(config, "use_degrees", True):
            raise ValueRangeError("plant.robot.use_degrees: must be true; shares of a range are no angles")
        self._robot: Any = client("lerobot.robots", _LEROBOT).make_robot_from_config(config)
        self._keys = [name + _ENDING for name in joints]
        self._scale = np.pi / 180 if plant.units == "deg" else 1.0
        self._reads = 0
        if missing := [key for key in self._keys if key not in self._robot.action_features]:
            known = ", ".join(key.removesuffix(_ENDING) for key in self._robot.action_features)
            raise UnknownNameError(
                f"plant.joints: no '{missing[0].removesuffix(_ENDING)}' on it (allowed: {known})"
            )
        self._robot.connect(calibrate=False)
        if not self._robot.is_calibrated:
            self._robot.disconnect()
            raise RuntimeError("is not calibrated; run lerobot-calibrate for it first")

    def take(self) -> None:
        """Nothing: it takes actions from the first."""

    def read(self) -> tuple[Array, object]:
        seen = self._robot.get_observation()
        self._reads += 1  # each is a measurement of its own, or raises
        return self._scale * np.array([seen[key] for key in self._keys], dtype=np.float64), self._reads

    def send(self, target: Array, rate: Array) -> None:
        self._robot.send_action(dict(zip(self._keys, (target / self._scale).tolist(), strict=True)))

    def fault(self) -> str:
        return "" if self._robot.is_connected else "the connection broke"

    def close(self) -> None:
        self._robot.disconnect()


def _config_class(name: str) -> Any:
    """Return LeRobot's configuration class of a type of robot; a type is known once its module is imported."""
    robots, utilities = client("lerobot.robots", _LEROBOT), import_module("lerobot.utils.import_utils")
    utilities.register_third_party_plugins()
    for each in pkgutil.iter_modules(robots.__path__):
        with suppress(ImportError):  # of a robot whose own library is not installed
            import_module(f"lerobot.robots.{each.name}")
    known = robots.RobotConfig.get_known_choices()
    if name not in known:
        raise UnknownNameError(
            f"plant.robot.type: LeRobot has no '{name}' (allowed: {', '.join(sorted(known))})"
        )
    return known[name]
