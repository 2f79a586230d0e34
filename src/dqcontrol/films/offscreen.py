"""An OpenGL context without a window, for MuJoCo's renderer."""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import ExistsError, FileFormatError, MissingExtraError, ValueRangeError, unknown_name
from dqcontrol.robots.files.mjcf import import_mujoco


def check_picture_file(target: Path, *, overwrite: bool) -> None:
    """Say why a picture cannot be saved there, if it cannot.

    Raises
    ------
    FileFormatError
        If its folder does not exist.
    ExistsError
        If the file exists and may not be replaced.
    """
    if not target.parent.is_dir():
        raise FileFormatError(f"{target.parent}: there is no such folder for {target.name}")
    if target.exists() and not overwrite:
        raise ExistsError(
            f"{target}: exists already; choose another name, or replace it with --force (overwrite=True)"
        )


BACKENDS = ("egl", "osmesa", "glfw")


@contextlib.contextmanager
def offscreen(width: int, height: int) -> Iterator[str]:
    """Make an OpenGL context current and give its backend: what MUJOCO_GL names, or else the first that works.

    Parameters
    ----------
    width, height
        Pixels.

    Raises
    ------
    MissingExtraError
        If this machine has no OpenGL.
    UnknownNameError
        If MUJOCO_GL names no backend.
    """
    import_mujoco()
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    if chosen and chosen not in BACKENDS:
        raise unknown_name("MUJOCO_GL", chosen, BACKENDS)
    failures, context, backend = [], None, ""
    for backend in [chosen] if chosen else BACKENDS:
        platform = os.environ.get("PYOPENGL_PLATFORM")
        try:
            context = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
            break
        except Exception as error:  # each backend fails in its own ways
            failures.append(f"{backend}: {error!s:.80}")
            if platform is None:
                os.environ.pop("PYOPENGL_PLATFORM", None)
    if context is None:
        raise MissingExtraError(
            f"picture: no OpenGL here ({'; '.join(failures)}); on Debian or Ubuntu: apt install libegl1, "
            "or libosmesa6 and MUJOCO_GL=osmesa"
        )
    context.make_current()
    try:
        yield backend
    finally:
        context.free()


@contextlib.contextmanager
def renderer(model: Any, width: int, height: int) -> Iterator[Callable[[Any], NDArray[np.uint8]]]:
    """Give a function that draws scenes of a model one after the other, (height, width, 3), inside of `offscreen`."""
    mujoco = import_mujoco()
    try:
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    except mujoco.FatalError as error:
        raise ValueRangeError(
            f"picture: OpenGL cannot draw {width} × {height} pixels here ({error})"
        ) from None
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
    rectangle = mujoco.MjrRect(0, 0, width, height)

    def draw(scene: Any) -> NDArray[np.uint8]:
        mujoco.mjr_render(rectangle, scene, context)
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, rectangle, context)
        return pixels[::-1]

    try:
        yield draw
    finally:
        context.free()
