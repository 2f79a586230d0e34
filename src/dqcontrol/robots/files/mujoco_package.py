"""MuJoCo, imported where it is needed: it reads MJCF files, and is the physics."""

from __future__ import annotations

import importlib
import logging
from typing import Any

from dqcontrol.errors import MissingExtraError


def import_mujoco(what: str = "mujoco: physics needs it and it") -> Any:
    """Return the mujoco package.

    Raises
    ------
    MissingExtraError
        If it is not installed; ``what`` begins the sentence.
    """
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError as error:
        raise MissingExtraError(
            f"{what} cannot be imported ({error}); pip install 'dqcontrol[physics]'"
        ) from None
    if mujoco.get_mju_user_warning() is None:  # by default MuJoCo writes a log file to the working folder
        mujoco.set_mju_user_warning(logging.getLogger("dqcontrol.mujoco").info)
    return mujoco
