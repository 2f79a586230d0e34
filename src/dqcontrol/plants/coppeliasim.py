"""An arm in CoppeliaSim, over its official ZMQ client."""

from __future__ import annotations

import math
import weakref
from contextlib import suppress
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import Error, ShapeError, ValueRangeError, as_positive, from_extra
from dqcontrol.plants.plant import Plant, RunningPlant, as_command, start_configuration
from dqcontrol.robots.robot import CommandMode, Robot

_STOPPED = 0  # sim.simulation_stopped
_MOST_WAITS = 1000  # steps of the simulator until it has stopped


class CoppeliaPlant(Plant, frozen=True, kw_only=True, tag="coppeliasim"):
    """The joints of a scene that CoppeliaSim has open, moved in steps over its ZMQ remote API.

    The scene's dynamics and joint controllers count as they are; the control period must be a multiple of its time
    step. Starting puts the joints where the run starts and starts the simulation, which is stopped at the end.

    Parameters
    ----------
    joints
        Paths of the joints in the scene, from base to end effector, as ``/LBRiiwa7R800/joint``.
    host, port
        Where CoppeliaSim listens.
    command_mode
        What a target grows by T u from: the last target (``integrated``) or the measured joint (``measured``); or no
        target but ``velocity``: u itself is the joint's target velocity.
    timeout
        After which a CoppeliaSim that does not answer counts as gone, s.

    Raises
    ------
    MissingExtraError
        When started, if the client is not installed.
    """

    is_supervised: ClassVar[bool] = True
    has_velocity_limits: ClassVar[bool] = True
    joints: Annotated[list[str], Meta(min_length=1, description="paths in the scene, from base to hand")]
    host: str = "127.0.0.1"
    port: Annotated[int, Meta(ge=1, le=65535)] = 23000
    command_mode: Literal["integrated", "measured", "velocity"] = "integrated"
    timeout: Annotated[float, Meta(gt=0, description="s")] = 5.0

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> RunningCoppelia:
        """Return the arm at start, its simulation started.

        Raises
        ------
        Error
            If CoppeliaSim does not answer, has no such joint, or another time step.
        """
        start = start_configuration(robot, start)
        if len(self.joints) != len(start):
            raise ShapeError(f"plant.joints: expected {len(start)} paths, got {len(self.joints)}")
        return RunningCoppelia(self, start, as_positive("period", period))

    def target_mode(self) -> CommandMode:
        """Return what targets grow from; joints follow also a velocity with a lag."""
        return "measured" if self.command_mode == "measured" else "integrated"


class RunningCoppelia(RunningPlant):
    """Joints in a running simulation."""

    def __init__(self, plant: CoppeliaPlant, start: Array, period: float) -> None:
        self._client = _connect(plant)
        self._address = f"{plant.host}:{plant.port}"
        self._mode, self._dt = plant.command_mode, period
        self._sim = self._call(self._client.require, "sim")
        self._joints = [self._joint(path) for path in plant.joints]
        self._stop()
        self._call(self._sim.setStepping, True)
        step = float(self._call(self._sim.getSimulationTimeStep))
        self._substeps = round(period / step)
        if self._substeps < 1 or abs(self._substeps * step - period) > 1e-9:
            raise ValueRangeError(
                f"plant: the scene's time step is {step:g} s; the period {period:g} s must be a multiple of it"
            )
        for joint, angle in zip(self._joints, start, strict=True):
            self._call(self._sim.setJointPosition, joint, float(angle))
            if self._mode != "velocity":
                self._call(self._sim.setJointTargetPosition, joint, float(angle))
        self.q: Array = start.copy()
        self.measured: Array = start.copy()
        self._target = start.copy()
        self._call(self._sim.startSimulation)
        self._closing = weakref.finalize(self, _leave, self._sim, self._client)

    def step(self, command: ArrayLike) -> None:
        """Move for one control period, as `RunningPlant.step` says; raise an `Error` if CoppeliaSim does not answer."""
        rate = as_command(command, len(self.q))
        if self._mode == "velocity":
            send, values = self._sim.setJointTargetVelocity, rate
        else:
            self._target = (self.measured if self._mode == "measured" else self._target) + self._dt * rate
            send, values = self._sim.setJointTargetPosition, self._target
        for joint, value in zip(self._joints, values, strict=True):
            self._call(send, joint, float(value))
        for _ in range(self._substeps):
            self._call(self._sim.step)
        for i, joint in enumerate(self._joints):
            self.q[i] = self._call(self._sim.getJointPosition, joint)
        self.measured[:] = self.q

    def close(self) -> None:
        """Stop the simulation and let go of the simulator."""
        self._closing()

    def _joint(self, path: str) -> int:
        try:
            return self._call(self._sim.getObject, path)
        except Error as error:
            raise ValueRangeError(f"plant.joints: no '{path}' in the scene ({error})") from None

    def _stop(self) -> None:
        for _ in range(_MOST_WAITS):
            if self._call(self._sim.getSimulationState) == _STOPPED:
                return
            self._call(self._sim.stopSimulation)
        raise Error(f"plant: the simulation at {self._address} does not stop")

    def _call(self, function: Any, *arguments: Any) -> Any:
        """Call the simulator; its own errors, and its silence, become ours."""
        try:
            return function(*arguments)
        except Exception as error:  # the client raises nothing more precise
            text = str(error).splitlines()[0] if str(error) else type(error).__name__
            if type(error).__name__ == "Again":
                text = "it does not answer; is the simulator running, and its ZMQ remote API server?"
            raise Error(f"plant: CoppeliaSim at {self._address}: {text}") from None


def _connect(plant: CoppeliaPlant) -> Any:
    names = "zmq", "coppeliasim_zmqremoteapi_client"
    zmq, remote_api = (from_extra(name, "coppeliasim", "plants in CoppeliaSim") for name in names)
    client = remote_api.RemoteAPIClient(plant.host, plant.port)
    for option in (zmq.RCVTIMEO, zmq.SNDTIMEO):
        client.socket.setsockopt(option, math.ceil(plant.timeout * 1000))
    client.socket.setsockopt(zmq.LINGER, 0)
    return client


def _leave(sim: Any, client: Any) -> None:
    with suppress(Exception):  # nobody is left to be told
        sim.stopSimulation()
        sim.setStepping(False)
    del client
