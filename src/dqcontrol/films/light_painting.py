"""The end effector's path as a long exposure shows a lamp that it holds."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import ExistsError, FileFormatError, ShapeError
from dqcontrol.figures.paths import path_plane
from dqcontrol.figures.style import first_of, new_figure
from dqcontrol.loop.record import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Lit = NDArray[np.bool_]

_GLOW = ((11.0, 0.035), (7.0, 0.06), (4.0, 0.16), (1.6, 0.9))  # width in points, opacity
_GLOW_OF_SEVERAL = ((5.0, 0.05), (3.0, 0.1), (1.6, 0.2), (0.7, 0.9))
_ACROSS = 3
_LIGHT, _CORE = "#5fb4ff", "#f4fbff"
_FRONT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_FRAMES, _FRAME_TIME, _LAST = 60, 0.08, 2.0  # of a clip; s
_DOTS = 80  # an inch


def light_painting(record: Record, lit: Lit | None = None) -> Figure:
    """Draw the end effector's path as a long exposure: seen along the plane of the desired path, or along y.

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


def light_paintings(records: Mapping[str, Record], lit: Mapping[str, Lit | None]) -> Figure:
    """Draw several as `light_painting`, side by side and to one scale, three in a row.

    Parameters
    ----------
    records
        Runs by title.
    lit
        When the lamp was on, by title, shape (N,) each; None: always.

    Raises
    ------
    ShapeError
        As `light_painting`, or if there is no run.
    """
    first_of(records)
    seen = {title: _seen(record, lit[title]) for title, record in records.items()}
    side = 1.25 * max(float((one.high - one.low).max()) for one in seen.values())
    across = min(len(seen), _ACROSS)
    rows = -(-len(seen) // across)
    figure = new_figure(7.16, 7.16 / across * rows)
    figure.set_facecolor("black")
    everywhere = figure.subplots(rows, across, squeeze=False).ravel()
    for axes in everywhere:
        axes.axis("off")
    for axes, (title, one) in zip(everywhere, seen.items(), strict=False):
        _expose(axes, one, _GLOW_OF_SEVERAL)
        middle = 0.5 * (one.low + one.high)
        axes.set_xlim(middle[0] - side / 2, middle[0] + side / 2)
        axes.set_ylim(middle[1] - side / 2, middle[1] + side / 2)
        axes.set_aspect("equal")
        axes.set_title(title, color=_LIGHT, y=-0.02)
    return figure


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


class _Seen(NamedTuple):
    """What a camera sees of a lamp: its strokes (M, 2, 2), how much light each leaves (M,), and their corners (2,)."""

    strokes: NDArray[np.float64]
    exposure: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def _seen(record: Record, lit: Lit | None) -> _Seen:
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
    return _Seen(strokes, exposure, flat[on].min(axis=0), flat[on].max(axis=0))


def _expose(axes: Axes, seen: _Seen, glow: Sequence[tuple[float, float]]) -> list[Any]:
    """Draw the light, and return its glows."""
    from matplotlib.collections import LineCollection

    glows = []
    for width, opacity in glow:
        lines = LineCollection(
            list(seen.strokes),
            colors=_CORE if opacity > 0.5 else _LIGHT,
            linewidths=width,
            alpha=opacity * seen.exposure,
            capstyle="round",
            rasterized=True,
        )
        glows.append(axes.add_collection(lines))
    return glows


def _exposed(record: Record, lit: Lit | None) -> tuple[Figure, NDArray[np.float64], list[Any]]:
    """Return the picture, its strokes (M, 2, 2) and their glows."""
    seen = _seen(record, lit)
    size = np.maximum(seen.high - seen.low, 1e-3)
    figure = new_figure(*(size * 5.6 / size.max() + 1.0))
    figure.set_facecolor("black")
    axes = figure.add_subplot()
    glows = _expose(axes, seen, _GLOW)
    edge = 0.08 * size.max()
    axes.set_xlim(seen.low[0] - edge, seen.high[0] + edge)
    axes.set_ylim(seen.low[1] - edge, seen.high[1] + edge)
    axes.set_aspect("equal")
    axes.axis("off")
    return figure, seen.strokes, glows
