"""What a law is for compiled code: position limits ask one, and each law is one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dqcontrol.compiled.compile import INPUT, READ, STATUS, WRITE, WRITE2
from dqcontrol.compiled.intrinsics import caller

# q, pose, room for a pose Jacobian, twist Jacobian, sample, parameters, state, work, out; work begins with the motion z
# that is preferred in the null space (m numbers), and the law answers u = z + J⁺(y − Jz). A law that needs the pose
# Jacobian fills its room by `fill_pose_jacobian`: most do not, and it is a tenth of a step.
LAW = STATUS(INPUT, WRITE, WRITE2, WRITE2, READ, READ, WRITE, WRITE, WRITE)

call_law: Callable[..., Any] = caller(LAW)
