"""The hand's path as a long exposure shows a lamp that it holds."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import ExistsError, FileFormatError, ShapeError
from dqcontrol.figures.paths import path_plane
from dqcontrol.figures.style import new_figure
from dqcontrol.loop.record import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Lit = NDArray[np.bool_]

_GLOW = ((11.0, 0.035), (7.0, 0.06), (4.0, 0.16), (1.6, 0.9))  # width in points, opacity
_LIGHT, _CORE = "#5fb4ff", "#f4fbff"
_FRONT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_FRAMES, _FRAME_TIME, _LAST = 60, 0.08, 2.0  # of a clip; s
_DOTS = 80  # an inch


def light_painting(record: Record, lit: Lit | None = None) -> Figure:
    """Draw the hand's path as a long exposure: seen along the plane of the desired path, or along y.

    A lamp that moves slowly leaves more light: the exposure of each stretch is the time spent on it.

    Parameters
    ----------
    record
        The run; samples that are not finite are left out.
    lit
        Whether the lamp was on, shape (N,); None: always.

    Raises
    ------
    ShapeError
        If fewer than two samples are finite and lit, or ``lit`` has another length.

    Examples
    --------
    >>> light_painting(run.record).savefig("painting.png")  # doctest: +SKIP
    """
    return _exposed(record, lit)[0]


def painting_clip(record: Record, path: str | Path, lit: Lit | None = None) -> None:
    """Save how the picture comes into being, in five seconds, as a GIF that plays for ever.

    Parameters
    ----------
    record, lit
        As for `light_painting`.
    path
        A new file, ``.gif``.

    Raises
    ------
    ShapeError, FileFormatError, ExistsError
        As `light_painting`, and if the file exists or has another ending.
    """
    target = Path(path)
    if target.suffix.lower() != ".gif":
        raise FileFormatError(f"{target}: must end in .gif, got '{target.suffix}'")
    if target.exists():
        raise ExistsError(f"{target}: exists already; choose another name")
    canvas = importlib.import_module("matplotlib.backends.backend_agg").FigureCanvasAgg
    image = importlib.import_module("PIL.Image")
    figure, strokes, glows = _exposed(record, lit)
    figure.set_dpi(_DOTS)
    sheet, pictures = canvas(figure), []
    shades = [glow.get_alpha() for glow in glows]
    for count in np.linspace(1, len(strokes), _FRAMES).round().astype(int):
        for glow, shade in zip(glows, shades, strict=True):
            glow.set_segments(list(strokes[:count]))
            glow.set_alpha(shade[:count])
        sheet.draw()
        pictures.append(image.fromarray(np.asarray(sheet.buffer_rgba())).convert("RGB").quantize(64))
    times = [round(1000 * _FRAME_TIME)] * (_FRAMES - 1) + [round(1000 * _LAST)]
    pictures[0].save(target, save_all=True, append_images=pictures[1:], duration=times, loop=0, optimize=True)


def _exposed(record: Record, lit: Lit | None) -> tuple[Figure, NDArray[np.float64], list[Any]]:
    """Return the picture, its strokes (M, 2, 2) and their glows."""
    from matplotlib.collections import LineCollection

    on = np.full(len(record.time), True) if lit is None else np.asarray(lit, dtype=bool)
    if on.shape != record.time.shape:
        raise ShapeError(f"lit: expected shape {record.time.shape}, got {on.shape}")
    on = on & np.isfinite(record.position).all(axis=1)
    if on.sum() < 2:
        raise ShapeError(f"record: needs at least two finite samples, got {on.sum()}")
    plane = path_plane(record.desired_position)
    flat = record.position @ (plane[0] if plane else _FRONT).T
    strokes = np.stack([flat[:-1], flat[1:]], axis=1)[on[:-1] & on[1:]]
    length = np.linalg.norm(strokes[:, 1] - strokes[:, 0], axis=1)
    moving = length > 0
    exposure = np.full(len(length), 1.0)
    exposure[moving] = np.clip(np.sqrt(np.median(length[moving]) / length[moving]), 0.35, 1.0)
    low, high = flat[on].min(axis=0), flat[on].max(axis=0)
    size = np.maximum(high - low, 1e-3)
    longest = 5.6 / size.max()
    figure = new_figure(*(size * longest + 1.0))
    figure.set_facecolor("black")
    axes, glows = figure.add_subplot(), []
    for width, opacity in _GLOW:
        colour = _CORE if opacity > 0.5 else _LIGHT
        glow = LineCollection(
            list(strokes),
            colors=colour,
            linewidths=width,
            alpha=opacity * exposure,
            capstyle="round",
            rasterized=True,
        )
        glows.append(axes.add_collection(glow))
    axes.set_xlim(low[0] - 0.08 * size.max(), high[0] + 0.08 * size.max())
    axes.set_ylim(low[1] - 0.08 * size.max(), high[1] + 0.08 * size.max())
    axes.set_aspect("equal")
    axes.axis("off")
    return figure, strokes, glows
