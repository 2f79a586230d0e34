"""A mobile manipulator, with one arm or two, on real wheels, moved by MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from msgspec import Meta
from msgspec.structs import replace

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array, as_each, unknown_name
from dqcontrol.plants.camera import Camera
from dqcontrol.plants.mobile.odometry import SEEN
from dqcontrol.plants.mobile.running_gear import RunningGear, running_gear
from dqcontrol.plants.mobile.running_mobile import RunningMobile, dofs_of, recorded_coordinates
from dqcontrol.plants.mobile.standing import check_standing
from dqcontrol.plants.mobile.wheeled_base import (
    WheeledBase,
    add_floor,
    add_wheel_motors,
    with_assumed_inertia,
)
from dqcontrol.plants.mujoco.gripper import Gripper, add_gripper
from dqcontrol.plants.mujoco.mujoco_model import add_arm, add_inertias, compiled, import_mujoco
from dqcontrol.plants.mujoco.mujoco_servos import JointServos
from dqcontrol.plants.mujoco.world_model import add_links, add_world
from dqcontrol.plants.plant import PhysicsPicture, plants_that_drive, start_within_limits
from dqcontrol.robots.bases import DifferentialDrive, RollerBase
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.two_arms import TwoArms
from dqcontrol.robots.whole_body import WholeBody
from dqcontrol.world import Body, World

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

LOCATIONS = ("true", "odometry", "camera", "fused")
_STIFF_FRICTION = 100.0  # stiffness of friction below its limit, against that of contacts
_CONTACT_STEPS = 5  # time constant of contacts, in time steps
_SETTLING = 0.5  # s; until the robot stands still on its contacts


class MobilePlant(JointServos, frozen=True, kw_only=True, tag="mobile"):
    """A base with one arm or two on a floor: wheels that roll and slip, casters or rollers, a gripper, things to grip.

    The base, a differential drive or one on mecanum or omni wheels, is a free body; its wheels touch the floor with
    friction and are turned by speed controllers, which get ω_r = (v + b ω)/r and ω_l = (v − b ω)/r, or what
    ``RollerBase.wheel_speeds`` says, all scaled down where the rims would be too fast. The arm's joints have
    the position servos of `MujocoPlant`, with the same parameters. In a world chassis, links and fingers touch bodies
    and the floor, and those links each other that the robot's file keeps apart. A base that does not stand under its
    arm in all postures within the joint limits is refused; a run ends as toppled when the base tilts by more than
    ``TOPPLED``, and as slipping when a wheel has slid faster than ``SLIDING`` for ``SLIDES_FOR``.

    Configuration x, y and φ are those of the point of the floor below the middle of the axle, or of all wheels; the
    whole pose of the base is recorded beside it.

    Parameters
    ----------
    location
        What measures x, y and φ: ``"true"``, ``"odometry"`` (the encoders of the wheels, which do not see slip), the
        ``"camera"``, or both, ``"fused"``: odometry from frame to frame, corrected at the time that a frame shows.
    camera
        That camera.
    base
        Friction of wheels and casters, and masses, size and motors of the chassis where they are not those of the
        robot's own.
    link_mass
        Of the arm's links, if it has no inertias: one number, or one a link, kg. They are then solid rods.
    link_radius
        Of those rods, m.
    gravity_compensation
        As of `MujocoPlant`; 0 by default, as in hobby servos.
    armature
        As of `MujocoPlant`.
    gripper
        At the end effector of one arm; none if omitted.
    world
        What chassis, links and fingers touch; the floor is there anyway. A spec gives its own.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> body = dqc.load_robot("little-john")
    >>> plant = MobilePlant().start(body, np.zeros(8), period=0.02, steps=50, seed=0)
    >>> for _ in range(50):
    ...     plant.step(np.array([0.3, 0, 0, 0, 0, 0, 0]))
    >>> bool(0.25 < plant.q[0] < 0.3)  # it takes a moment until it drives
    True
    """

    location: Literal["true", "odometry", "camera", "fused"] = "true"
    camera: Camera = Camera()
    base: WheeledBase = WheeledBase()
    link_mass: Annotated[float | list[float], Meta(description="kg")] = 0.15
    link_radius: Annotated[float, Meta(gt=0, le=1, description="m")] = 0.025
    gravity_compensation: Annotated[float, Meta(ge=0, le=1, description="share of the gravity torque")] = 0.0
    armature: Annotated[float | list[float], Meta(description="kg m² or kg")] = 0.02
    gripper: Gripper | None = None
    world: World | None = None
    touches_world: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.location not in LOCATIONS:
            raise unknown_name("plant.location", str(self.location), LOCATIONS)
        if (as_array("plant.link_mass", self.link_mass) <= 0).any():
            raise ValueRangeError(f"plant.link_mass: must be > 0, got {self.link_mass}")

    def in_world(self, world: World) -> Self:
        """Return it with what its chassis, links and fingers touch."""
        return replace(self, world=world)

    @property
    def bodies(self) -> dict[str, Body]:
        """What stands on the floor, by name."""
        given = {} if self.world is None else self.world.bodies
        return {name: body for name, body in given.items() if not body.is_floor}

    def body_of(self, robot: Robot) -> Robot:
        """Return the robot with the chassis of this plant."""
        return self.base.body_of(robot)

    def base_errors(self) -> tuple[float, float]:
        """Return the camera's standard deviations, m and rad."""
        camera = self.camera if self.location in SEEN else None
        return (camera.position_noise, camera.angle_noise) if camera else (0.0, 0.0)

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> RunningMobile:
        """Return the robot at rest at start, standing on its wheels.

        Parameters
        ----------
        robot
            A whole body: a differential drive or a base on wheels with rollers first, then arms and fixed poses; or two
            arms on one.
        start
            First configuration, shape (n,), rad or m, joints within their limits.
        period
            Control period T, s.
        steps
            Number of periods.
        seed
            Of the noise of encoders and camera.

        Raises
        ------
        MissingExtraError
            If mujoco is not installed.
        Error
            If the robot has another base, one whose body is unknown, or one that falls over under its arm, or something
            does not fit it.
        """
        robot = self.body_of(robot)
        gear, arm = self._parts_of(robot)
        if arm is not None:
            check_standing(robot.name, gear, arm)
        start = start_within_limits(robot, start)
        substeps = self.substeps(period)
        model = self._mobile_model(robot, gear, arm)
        live = RunningMobile(self, robot, gear, arm, model, substeps, (period, steps, seed))
        live.place(start)
        mujoco = import_mujoco()
        mujoco.mj_forward(model, live.data)
        live.check_start()
        if arm is not None:
            self.set_servos(arm, model, live.data, start[3:], live.dofs)
        live.settle(start, round(_SETTLING / self.timestep))
        return live

    def picture(self, robot: Robot) -> PhysicsPicture:
        """Return robot, gripper and what stands around, as they move in physics; see `Plant.picture`."""
        gear, arm = self._parts_of(robot)
        seen = {
            name: body for name, body in self.bodies.items() if body.role != "moving"
        }  # drawn where it is
        return PhysicsPicture(
            self._spec(robot, gear, arm, seen),
            np.array([[*body.position[:2], 0.0] for body in seen.values()]).reshape(-1, 3),
            lambda model, q, readings: recorded_coordinates(
                model, robot, q, readings, gear.joints, self.gripper, seen
            ),
        )

    def _parts_of(self, robot: Robot) -> tuple[RunningGear, Robot | None]:
        """Return what the robot drives on and what that carries, one arm or two on a torso, with inertias."""
        body = robot.base if isinstance(robot, TwoArms) else robot
        parts = body.parts if isinstance(body, WholeBody) else ()
        drive = parts[0] if parts else None
        carried = [part for part in parts[1:] if isinstance(part, SerialArm | np.ndarray)]
        if (
            not isinstance(drive, DifferentialDrive | RollerBase)
            or len(carried) < len(parts) - 1
            or len(robot.bases) > 1
        ):
            found = ", ".join(type(part).__name__ for part in parts if not isinstance(part, np.ndarray))
            raise ValueRangeError(
                f"plant: mobile moves a body that starts with its only base, a DifferentialDrive, MecanumBase or "
                f"OmniBase, got {robot.name}: {found or type(robot).__name__}; {plants_that_drive(robot)}"
            )
        gear = running_gear(self.base.under(drive, robot.name), drive)
        torso = (
            [SerialArm.join(carried, robot.name)]
            if any(isinstance(part, SerialArm) for part in carried)
            else []
        )
        if not isinstance(robot, TwoArms):
            return gear, self._with_inertias(torso)[0] if torso else None
        if self.gripper is not None:
            raise ValueRangeError(
                f"plant.gripper: is at the end effector of one arm, and {robot.name} has two"
            )
        if len(robot.drives) and robot.input_size == robot.configuration_size:
            raise ValueRangeError(
                f"plant: mobile drives two arms by v and ω, and {robot.name} is unconstrained; "
                "give its base 'form: constrained'"
            )
        arms = [part for part in (robot.left, robot.right) if isinstance(part, SerialArm)]
        if not torso:
            arms = [SerialArm.join([*carried, arm], arm.name) for arm in arms]
        *base, left, right = self._with_inertias([*torso, *arms])
        return gear, TwoArms(left, right, base=base[0] if base else None, name=robot.name)

    def _with_inertias(self, arms: list[SerialArm]) -> list[SerialArm]:
        """Return arms with inertias, those assumed if one has none."""
        if all(arm.inertia is not None for arm in arms):
            return arms
        ends = np.cumsum([arm.configuration_size for arm in arms])
        masses = np.split(as_each("plant.link_mass", self.link_mass, int(ends[-1])), ends[:-1])
        return [
            with_assumed_inertia(arm, mass, self.link_radius) for arm, mass in zip(arms, masses, strict=True)
        ]

    def _spec(self, robot: Robot, gear: RunningGear, arm: Robot | None, bodies: dict[str, Body]) -> Any:
        """Return robot, gripper and what stands around without motors."""
        mujoco = import_mujoco()
        spec = mujoco.MjSpec()
        spec.modelname = robot.name
        spec.compiler.degree, spec.compiler.autolimits = False, True
        add_floor(spec)
        body = gear.add_to(spec, robot.chain[3, 4:7])
        if arm is not None:
            add_arm(body, arm)
            add_inertias(spec, arm)
            self.add_servos(spec, arm)
            body = spec.body(f"link_{arm.configuration_size}")
        else:
            body.add_site(name="hand", pos=robot.chain[-1, 4:7], quat=robot.chain[-1, :4], size=[1e-3] * 3)
        mass = gear.mass
        mass += 0.0 if arm is None or arm.inertia is None else float(arm.inertia.mass.sum())
        add_wheel_motors(spec, gear.base, gear.joints, gear.radius, mass)
        if self.gripper is not None:
            add_gripper(spec, self.gripper, body, robot.chain[-1], self.timestep)
        add_world(spec, bodies, self.timestep)
        return spec

    def _mobile_model(self, robot: Robot, gear: RunningGear, arm: Robot | None) -> Any:
        """Return the model, with contacts that grip: friction is nearly rigid below its limit."""
        mujoco = import_mujoco()
        spec = self._spec(robot, gear, arm, self.bodies)
        if self.world is not None and arm is not None:
            base = robot.configuration_size - arm.configuration_size
            add_links(spec, robot, self.timestep, gripper=self.gripper, base=base)
        option = spec.option
        option.timestep, option.gravity = self.timestep, self.gravity
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, _STIFF_FRICTION
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        model = compiled(spec)
        model.geom_solref[:] = (_CONTACT_STEPS * self.timestep, 1)
        damping = model.dof_damping.reshape(model.nv, -1)[:, 0]
        names = robot.joint_names[3:]
        damping[dofs_of(model, names)] = as_each("plant.viscous_friction", self.viscous_friction, len(names))
        return model
