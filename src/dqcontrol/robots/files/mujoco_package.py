"""MuJoCo, imported where it is needed: it reads MJCF files, and is the physics."""

from __future__ import annotations

import logging
from typing import Any

from dqcontrol.errors import from_extra


def import_mujoco(what: str = "physics and models of MuJoCo") -> Any:
    """Return the mujoco package.

    Raises
    ------
    MissingExtraError
        If it is not installed; ``what``, in the plural, needs it.
    """
    mujoco = from_extra("mujoco", "physics", what)
    if mujoco.get_mju_user_warning() is None:  # by default MuJoCo writes a log file to the working folder
        mujoco.set_mju_user_warning(logging.getLogger("dqcontrol.mujoco").info)
    return mujoco
