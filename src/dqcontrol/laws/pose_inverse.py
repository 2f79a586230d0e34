"""The damped inverse of a law's own eight rows, as the literature writes it. [S17 4.19, Wampler 1986]"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from msgspec import Meta

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.compiled.compile import inline
from dqcontrol.laws.growth import NO_ERROR
from dqcontrol.laws.hand_twist import twist_work
from dqcontrol.laws.inverses import DampedInverse, InverseParameters, solve
from dqcontrol.named_fields import CheckedFields
from dqcontrol.robots.kinematics.kinematics_kernels import hand_jacobian

DAMPED_POSE = 3.0  # beside the kinds of `inverses`


class DampedPoseInverse(
    CheckedFields, frozen=True, tag="damped-pose", tag_field="kind", forbid_unknown_fields=True
):
    """Damped least squares of the law's own matrix of eight rows: J⁺ = Jᵀ(JJᵀ + λ²I)⁻¹. [S17 4.19, Wampler 1986]

    J is the pose Jacobian, vec8(ẋ) = J u, in `FeedbackLinearization`. To compare with the literature only: |vec8(ẋ)|
    weighs turning by how far the end effector is from the base frame's origin, so that commands depend on where that
    lies. With d from there to the end effector, and v the velocity of the body's point midway,

    |vec8(ẋ)|² = ¼ (|ω|² + ¼ (d·ω)² + |v|²),

    so that the eight rows are six in this measure: (JᵀJ + λ²I)⁻¹Jᵀ is the same matrix. At d = 0 it is a
    `DampedInverse` of 2λ with ℓ = 1 m.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> robot, q = dqc.load_robot("little-john"), np.array([0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4])
    >>> target = dqc.Sample(robot.fkm(q + [0.1, 0.05, 0, 0, 0, 0, 0, 0]))
    >>> inverse = dqc.laws.DampedPoseInverse(damping=0.05)
    >>> law = dqc.laws.FeedbackLinearization(stiffness=1.0, damping=1.0, inverse=inverse)
    >>> dict(zip(robot.input_names, law.command(robot, q, target, period=0.05).round(4).tolist()))["v"] > 0
    True
    """

    spec_key: ClassVar[str] = "inverse"
    damping: Annotated[float, Meta(gt=0, description="λ, of the pose's eight numbers a radian of the joints")]

    def parameters(self) -> InverseParameters:
        """Return kind and numbers as compiled code reads them."""
        return DampedInverse(damping=self.damping).parameters()._replace(kind=DAMPED_POSE)


@inline
def solve_pose_rows(pose, lever, twist_jacobian, hand_twist, preferred, inverse_numbers, work, out):
    """Write out = z + J⁺ (t − J z) for the twist t = [ω ; ṗ], J⁺ damped in |vec8(ẋ)|, see `DampedPoseInverse`.

    The lever goes to the end effector from the origin of the frame that x is measured in; all is in inertial axes.
    """
    own = twist_work(work, twist_jacobian.shape[1])
    matrix, twist = own.matrix, own.twist
    (px, py, pz), (dx, dy, dz) = position(pose), lever
    hand_jacobian((px - 0.5 * dx, py - 0.5 * dy, pz - 0.5 * dz), twist_jacobian, matrix)
    a, b, c = hand_twist[0], hand_twist[1], hand_twist[2]
    twist[0], twist[1], twist[2] = a, b, c
    twist[3] = hand_twist[3] - 0.5 * (b * dz - c * dy)
    twist[4] = hand_twist[4] - 0.5 * (c * dx - a * dz)
    twist[5] = hand_twist[5] - 0.5 * (a * dy - b * dx)
    # (I + along dd')² = I + ¼dd'
    along = 0.25 / (1.0 + math.sqrt(1.0 + 0.25 * (dx * dx + dy * dy + dz * dz)))
    for i in range(matrix.shape[1]):
        turn = along * (dx * matrix[0, i] + dy * matrix[1, i] + dz * matrix[2, i])
        matrix[0, i] += turn * dx
        matrix[1, i] += turn * dy
        matrix[2, i] += turn * dz
        for k in range(6):
            matrix[k, i] *= 0.5
    turn = along * (dx * a + dy * b + dz * c)
    twist[0] += turn * dx
    twist[1] += turn * dy
    twist[2] += turn * dz
    for k in range(6):
        twist[k] *= 0.5
    missing = twist_jacobian, (px, py, pz), NO_ERROR, 1.0  # damping does not grow
    return solve(matrix, twist, preferred, missing, inverse_numbers, own.solver, out)
