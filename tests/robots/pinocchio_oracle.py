"""Pinocchio models to compare arms with."""
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (Pinocchio's compiled names are invisible to pyright)

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from dqcontrol.robots import SerialArm, load_robot, robot_names

ARMS = tuple(name for name in robot_names() if isinstance(load_robot(name), SerialArm))
Z_GRAVITY = np.array([0.0, 0.0, -9.81])


def se3(row):
    """Return [quaternion, position] as SE3."""
    w, x, y, z = row[:4]
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().toRotationMatrix(), np.array(row[4:7]))


def pose_matrix(x):
    """Return a unit dual quaternion as a homogeneous matrix, by the definition x = r + ε½pr."""
    r, d = x[:4], x[4:]
    p = 2 * (r[0] * d[1:] - d[0] * r[1:] - np.cross(d[1:], r[1:]))
    return se3([*r, *p]).homogeneous


def model_of(arm: SerialArm):
    """Build a Pinocchio model joint by joint from an arm's own data."""
    model = pin.Model()
    model.gravity.linear = Z_GRAVITY
    parent = 0
    for i, kind in enumerate(arm.joint_types):
        joint = pin.JointModelRZ() if kind == "revolute" else pin.JointModelPZ()
        parent = model.addJoint(parent, joint, se3(arm.chain[i]), arm.joint_names[i])
        if arm.inertia is not None:
            body = pin.Inertia(arm.inertia.mass[i], arm.inertia.center[i], arm.inertia.tensor[i])
            model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.addFrame(pin.Frame("tool", parent, 0, se3(arm.chain[-1]), pin.FrameType.OP_FRAME))
    return model


@dataclass
class UrdfOracle:
    """The URDF as Pinocchio reads it, other joints locked at zero; results in the base link's frame."""

    path: Path
    arm: SerialArm
    base: str
    tip: str

    def __post_init__(self):
        full = pin.buildModelFromUrdf(str(self.path))
        locked = [full.getJointId(name) for name in full.names[1:] if name not in self.arm.joint_names]
        self.model = pin.buildReducedModel(full, locked, pin.neutral(full))
        self.data = self.model.createData()
        assert list(self.model.names[1:]) == list(self.arm.joint_names)
        pin.framesForwardKinematics(self.model, self.data, pin.neutral(self.model))
        self.base_pose = self.data.oMf[self.model.getFrameId(self.base)].copy()
        self.model.gravity.linear = self.base_pose.rotation @ Z_GRAVITY

    def configuration(self, q):
        """Return Pinocchio's configuration: continuous joints are (cos, sin) there."""
        pairs = zip(q, self.model.joints[1:], strict=True)
        return np.concatenate([[a] if j.nq == 1 else [np.cos(a), np.sin(a)] for a, j in pairs])

    def tip_pose(self, q):
        pin.framesForwardKinematics(self.model, self.data, self.configuration(q))
        return (self.base_pose.inverse() * self.data.oMf[self.model.getFrameId(self.tip)]).homogeneous

    def twist_jacobian(self, q):
        """Rows ω then velocity of the point at the base's origin: the inertial twist."""
        jacobian = pin.computeFrameJacobian(
            self.model, self.data, self.configuration(q), self.model.getFrameId(self.tip), pin.WORLD
        )
        jacobian = self.base_pose.toActionMatrixInverse() @ jacobian
        return np.vstack([jacobian[3:], jacobian[:3]])

    def gravity_forces(self, q):
        return pin.computeGeneralizedGravity(self.model, self.data, self.configuration(q))

    def mass_matrix(self, q):
        return symmetric(pin.crba(self.model, self.data, self.configuration(q)))


def symmetric(upper):
    """Fill the lower triangle that crba leaves open."""
    return np.triu(upper) + np.triu(upper, 1).T
