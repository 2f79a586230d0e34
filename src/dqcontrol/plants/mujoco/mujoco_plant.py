"""An arm with masses under position servos, moved by MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from msgspec.structs import replace

from dqcontrol.arrays import Array
from dqcontrol.contact import Impedance, PreparedImpedance
from dqcontrol.errors import ValueRangeError, as_each
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.mujoco.gripper import Gripper, Pads, add_gripper, fingers
from dqcontrol.plants.mujoco.mujoco_model import add_inertias, compiled, import_mujoco, skeleton
from dqcontrol.plants.mujoco.mujoco_servos import JointServos, mass_matrix
from dqcontrol.plants.mujoco.running_mujoco import RunningMujoco
from dqcontrol.plants.mujoco.world_model import add_links, add_world
from dqcontrol.plants.mujoco.wrist_sensor import add_wrist
from dqcontrol.plants.plant import plants_that_drive, start_within_limits
from dqcontrol.plants.wrist import Wrist
from dqcontrol.robots.robot import base_coordinates
from dqcontrol.world import World

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


class MujocoPlant(JointServos, frozen=True, kw_only=True, tag="mujoco"):
    """Joints with masses, gravity and torque limits, held by position servos or by an impedance.

    Each servo applies τ = k_p (q* − q) − k_d q̇, clipped to the joint's effort limit. The velocity command u
    becomes servo targets once a period T; the target q* moves linearly from where it is to its new value over
    the period, as the interpolators of real arms do: a target that jumped would kick the joints by k_p T u.

    The arm starts at rest and in balance: the first target is start + τ_g / k_p, with τ_g the part of the
    gravity torque that is not compensated. As that part changes with the configuration, the joints sag.
    Position limits are mechanical stops, where a joint has both.

    With ``impedance`` the arm is driven by torque: at each time step those of springs and dampers between the end
    effector and its pose at the targets, with the same limits, in place of the servos'. Measured are then the
    targets, which are what a law leads; else it would wind up the springs of an arm that gives way.

    Parameters
    ----------
    command_mode
        ``"integrated"``: q* grows by T u, whatever the joint does; at constant u the joint moves with
        velocity u, k_d / k_p seconds late. ``"measured"``: q* = measured q + T u, as of drivers that add the
        command to the encoder's reading; the joint then settles at the velocity u k_p T / (k_p T + k_d) and
        gives way to whatever part of gravity is not compensated.
    bandwidth
        Hz; k_p = M (2π bandwidth)² for each joint, M the diagonal of the joint-space inertia at the start,
        armature included: one number, or one a joint. In specs ``file`` names a plant file of `dqcontrol identify`,
        of which bandwidths, damping ratios, encoders and the command mode are taken.
    damping_ratio
        ζ; k_d = 2 ζ √(k_p M): one number, or one a joint.
    stiffness, damping
        k_p (N·m/rad or N/m) and k_d (N·m·s/rad or N·s/m) in place of those: one number, or one a joint.
    timestep
        s; the control period must be a multiple of it.
    gravity
        m/s² in the base frame; (0, 0, 0) for none.
    gravity_compensation
        Share of the gravity torque that the arm's own controller adds, 0 to 1; 1 as in most industrial arms.
    armature
        Rotor inertia seen at the joint, kg m² (kg for sliding joints): one number, or one a joint.
    viscous_friction, dry_friction
        N·m·s/rad and N·m (N·s/m and N): one number, or one a joint.
    gripper
        At each end effector; none if omitted.
    pads
        On both of two end effectors, to carry something between them; none if omitted.
    wrist
        A force sensor at the end effector with a tool; nothing if omitted.
    impedance
        See `dqcontrol.contact.Impedance`; position servos if omitted. Its sensor is the wrist's, without noise.
    world
        What links touch, each other included; nothing if omitted. A spec gives its own.
    position_limit
        True: targets do not leave the position limits either.
    encoder_resolution
        Step of the measured position, rad or m: one number, or one a joint; 0 for none.
    encoder_noise
        Standard deviation of the measured position, rad or m, white: one number, or one a joint.

    Raises
    ------
    UnknownNameError, ValueRangeError, ShapeError
        If a parameter lies outside of what is allowed.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> plant = MujocoPlant(bandwidth=10).start(arm, np.full(7, 0.3), period=0.01, steps=1, seed=0)
    >>> plant.step(np.zeros(7))
    >>> bool(abs(plant.q - 0.3).max() < 1e-6)
    True
    """

    gripper: Gripper | None = None
    pads: Pads | None = None
    wrist: Wrist | None = None
    impedance: Impedance | None = None
    world: World | None = None
    touches_world: ClassVar[bool] = True

    def in_world(self, world: World) -> Self:
        """Return it with what its links touch."""
        return replace(self, world=world)

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> RunningMujoco:
        """Return the arm at rest at start.

        Parameters
        ----------
        robot
            An arm with inertias.
        start
            First configuration, shape (n,), rad or m, within the position limits.
        period
            Control period T, s.
        steps
            Number of periods; a live arm can be stepped further, as its noise is drawn step by step.
        seed
            Of the encoder noise; the same seed gives bit-equal runs.

        Raises
        ------
        MissingExtraError
            If mujoco is not installed.
        ShapeError, ValueRangeError
            If start, period or a parameter does not fit the robot, its inertias do not allow physics, or its effort
            limits cannot hold it at start.
        """
        if base_coordinates(robot).any():
            raise ValueRangeError(
                f"plant.kind: mujoco moves arms, and {robot.name} has a mobile base; {plants_that_drive(robot)}"
            )
        if robot.follows:
            raise ValueRangeError(
                f"plant.kind: in physics of {robot.name} {robot.follows[0]} would have to follow another joint "
                "(mimic), which no servo of it does; take the ideal or the servo plant"
            )
        if self.pads is not None and (self.world is None or self.gripper is not None):
            others = "'world'" if self.world is None else "pads or a gripper, not both"
            raise ValueRangeError(f"plant.pads: press a body of the world between them; give {others}")
        start = start_within_limits(robot, start)
        substeps = self.substeps(period)
        model = self._model(robot, start)
        data = self._balance(robot, model, start)
        if self.pads is not None:
            data.act[:] += self.pads.squeezed(robot, start)
        return RunningMujoco(self, robot, model, data, substeps, seed)

    def _model(self, robot: Robot, start: Array) -> Any:
        """Build the model; gains are set later, at the start configuration."""
        mujoco = import_mujoco()
        n = robot.configuration_size
        spec = skeleton(robot)
        add_inertias(spec, robot)
        self.add_servos(spec, robot)
        if self.world is None:
            spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT  # nothing here touches anything
        if self.world is not None:
            add_links(spec, robot, self.timestep, padded=self.pads is not None, gripper=self.gripper)
            add_world(spec, self.world.bodies, self.timestep)
            spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC  # with friction as stiff as pressure allows:
            spec.option.impratio = 50.0  # no creeping
            spec.option.enableflags |= getattr(
                mujoco.mjtEnableBit, "mjENBL_SLEEP", 0
            )  # what lies costs nothing
        if self.pads is not None:
            self.pads.add(spec, robot, start, self.timestep)
        if self.wrist is not None:
            add_wrist(spec, self.wrist, robot, self.timestep, self.gravity_compensation)
        if self.gripper is not None:
            for k, row in enumerate(robot.ends):
                link = spec.body(f"link_{int(robot.parents[row]) + 1}")
                add_gripper(spec, self.gripper, link, robot.chain[row], self.timestep, k)
                for name in fingers(k):
                    spec.body(name).gravcomp = self.gravity_compensation
        for i, name in enumerate(robot.joint_names):
            spec.body(f"link_{i + 1}").gravcomp = self.gravity_compensation
            spec.joint(name).actgravcomp = True
        model = compiled(spec)
        model.dof_damping.reshape(model.nv, -1)[:n, 0] = as_each(
            "plant.viscous_friction", self.viscous_friction, n
        )
        return model

    def _balance(self, robot: Robot, model: Any, start: Array) -> Any:
        """Return the model's state at rest in the start configuration."""
        mujoco = import_mujoco()
        data = mujoco.MjData(model)
        data.qpos[: len(start)] = start
        mujoco.mj_forward(model, data)
        self.set_servos(robot, model, data, start, np.arange(len(start)))
        mujoco.mj_forward(model, data)
        return data

    def by_effort(self) -> Self:
        """Return it with servos that only hold, while nothing drives the joints."""
        return replace(self, impedance=None)

    def prepared_impedance(self, robot: Robot) -> PreparedImpedance | None:
        """Return its impedance for a robot, with what MuJoCo leaves of the weight."""
        if self.impedance is None:
            return None
        left = 1.0 - self.gravity_compensation
        return self.impedance.prepare(robot, self.gravity, left, self.armature)

    def compliance(self, robot: Robot, start: Array) -> Array:
        """Return 1/k_p of each joint at start; 0 of an impedance, which is on the safe side."""
        live = self.start(robot, start, self.timestep, 1, 0)
        return np.zeros(len(start)) if live.drive is not None else 1.0 / live.stiffness

    def linear_model(self, robot: Robot, start: Array, period: float) -> LinearModel:
        """Return all joints together, coupled by their inertia at start, in MuJoCo's own time steps.

        A step h takes v⁺ = (M + hD)⁻¹ (M v + h k_p (q* − q)) with D of servos and viscous friction, then
        q⁺ = q + h v⁺. What changes with the configuration (gravity, inertia), dry friction, effort limits and
        encoders are left out. Torques of an impedance are taken by their slopes;
        as if a law saw the joints, which move later than the targets that it sees.
        """
        h, steps, n = self.timestep, self.substeps(period), robot.configuration_size
        live = self.start(robot, start, period, 1, 0)
        if live.drive is not None:
            viscous = live.model.dof_damping.reshape(live.model.nv, -1)[:n, 0]
            return live.drive.linear_model(live.model, live.data, h, steps, viscous)
        mass, unit, zero = mass_matrix(live.model, live.data)[:n, :n], np.eye(n), np.zeros((n, n))
        damping = np.diag(live.damping + live.model.dof_damping.reshape(live.model.nv, -1)[:n, 0])
        pull = h * np.linalg.solve(mass + h * damping, np.diag(live.stiffness))
        velocity = np.hstack([-pull, np.linalg.solve(mass + h * damping, mass), pull])
        step = np.eye(3 * n)  # of q, v and q*
        step[n : 2 * n] = velocity
        step[:n] += h * velocity
        transition, inputs = np.eye(3 * n), np.zeros((3 * n, n))
        for _ in range(steps):
            transition, inputs = step @ transition, step @ inputs
            inputs[2 * n :] += h * unit
        if self.command_mode == "measured":  # the target moves at the rate that ends at measured + T u
            transition += inputs @ np.hstack([unit, zero, -unit]) / period
        return LinearModel(transition, inputs)
