"""Signatures of a law, and of the constraints around it, in compiled code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types

from dqcontrol.compiled.compile import INPUT, READ, READ2, STATUS, WRITE, WRITE2
from dqcontrol.compiled.intrinsics import ADDRESS, caller

# q, pose, room for a pose Jacobian, twist Jacobian, sample, parameters, state, work, out; work begins with the motion z
# that is preferred in the null space (m numbers), and the law answers u = z + J⁺(y − Jz). A law that needs the pose
# Jacobian fills its room by `fill_pose_jacobian`: most do not, and it is a tenth of a step.
LAW = STATUS(INPUT, WRITE, WRITE2, WRITE2, READ, READ, WRITE, WRITE, WRITE)

# kinematics, chain, q, sample, its number, twist Jacobian, what further tasks add to H (m × m numbers, or none), state
# (its end is the memory), parameters, work, command
CONSTRAINT = STATUS(ADDRESS, READ2, INPUT, READ, types.intp, READ2, READ, WRITE, READ, WRITE, WRITE)

call_law: Callable[..., Any] = caller(LAW)
