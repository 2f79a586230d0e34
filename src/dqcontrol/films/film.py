"""Pictures of a run at some of its samples, by MuJoCo without a window."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.films.framing import Framing
from dqcontrol.films.ghosts import COLOURS, add_ghost
from dqcontrol.films.offscreen import offscreen, renderer
from dqcontrol.films.scene_background import add_scene_background
from dqcontrol.plants.mujoco.mujoco_model import compiled, import_mujoco

Pixels = NDArray[np.uint8]

# Less than for single pictures, as there are many. At 720p without a graphics card a frame takes 0.075 s of processor
# time: 0.045 s for the shadow, half of that for the pieces of paths in it, the rest for pixels.
_SHADOWS, _SLICES, _STACKS = 1024, 24, 4
_OF_BALLS = 10  # stacks; with fewer balls are no longer round, and they cost a frame a quarter more
_GHOST, _BEHIND = 0.4, 3e-3  # opacity of further runs, and how far they stay behind the first in its place, m
_SMOOTHED = 500_000  # pixels; the edges of larger frames are not smoothed


@dataclass(frozen=True)
class Film:
    """What a camera needs of a run.

    Attributes
    ----------
    spec
        ``mjSpec`` of all that moves, without floor and light.
    framing
        Where to look.
    configurations
        Gives MuJoCo's coordinates at each sample, shape (N, nq), for the compiled model.
    azimuth, elevation
        Direction of view unless another is asked for, degrees.
    decorate
        Adds to MuJoCo's scene what belongs to sample k.
    decorations
        How many shapes that are at most.
    is_overlaid
        Whether one picture shows the whole run, earlier configurations through the last.
    further
        Give the coordinates of further runs, which show through the first.
    has_balls
        Whether balls are to look round.
    """

    spec: Any
    framing: Framing
    configurations: Callable[[Any], NDArray[np.float64]]
    azimuth: float
    elevation: float
    decorate: Callable[[Any, int], None] = lambda scene, k: None
    decorations: int = 0
    is_overlaid: bool = True
    further: Sequence[Callable[[Any], NDArray[np.float64]]] = ()
    has_balls: bool = False


def frames(
    film: Film,
    samples: NDArray[np.int_],
    width: int,
    height: int,
    azimuth: float | None = None,
    elevation: float | None = None,
) -> Iterator[Pixels]:
    """Give the pictures of some samples one after the other, shapes (height, width, 3).

    Parameters
    ----------
    film
        What to draw.
    samples
        A row for each picture: a sample of the run, and one of each further run.
    width, height
        Pixels.
    azimuth, elevation
        Direction of view in place of the film's, degrees.

    Raises
    ------
    MissingExtraError
        If mujoco is not installed, or this machine has no OpenGL.
    """
    mujoco = import_mujoco()
    framing, towards = film.framing, film.azimuth if azimuth is None else azimuth
    add_scene_background(mujoco, film.spec, framing, towards, (width, height))
    quality = film.spec.visual.quality
    quality.shadowsize, quality.numslices = _SHADOWS, _SLICES
    quality.numstacks = _OF_BALLS if film.has_balls else _STACKS
    if width * height > _SMOOTHED:
        quality.offsamples = 0
    model = compiled(film.spec)
    data = mujoco.MjData(model)
    configurations = film.configurations(model)
    ghosts = [(mujoco.MjData(model), coordinates(model)) for coordinates in film.further]
    scene = mujoco.MjvScene(model, maxgeom=(2 + len(ghosts)) * model.ngeom + 100 + film.decorations)
    options, nobody, camera = mujoco.MjvOption(), mujoco.MjvPerturb(), mujoco.MjvCamera()
    options.geomgroup[4] = 0
    camera.lookat[:], camera.distance = framing.middle, framing.distance
    camera.azimuth, camera.elevation = towards, film.elevation if elevation is None else elevation
    everything, away = mujoco.mjtCatBit.mjCAT_ALL.value, _BEHIND * _direction(camera)
    with offscreen(width, height), renderer(model, width, height) as draw:
        for k, *others in samples:
            data.qpos[:] = configurations[k]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            mujoco.mjv_updateScene(model, data, options, nobody, camera, everything, scene)
            for i, ((ghost, places), j) in enumerate(zip(ghosts, others, strict=True)):
                ghost.qpos[:] = places[j]
                mujoco.mj_kinematics(model, ghost)
                add_ghost(mujoco, model, ghost, scene, _GHOST, COLOURS[i % len(COLOURS)], away)
            film.decorate(scene, int(k))
            yield draw(scene)


def _direction(camera: Any) -> NDArray[np.float64]:
    """Return where a camera looks."""
    azimuth, elevation = np.radians([camera.azimuth, camera.elevation])
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
