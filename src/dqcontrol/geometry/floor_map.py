"""Maps of floors that bases and arms keep out of: polygons, or a grid as of ROS's map server, read and written."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import (
    ExistsError,
    FileFormatError,
    ShapeError,
    ValueRangeError,
    as_array,
    as_positive,
    writing,
)
from dqcontrol.files.input_file import read_text, version
from dqcontrol.files.output_file import whole_file, yaml_text
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.geometry.shapes import Box

_HEIGHT = 2.0  # m
_EDGE = 0.01  # m; thickness of the walls that stand for a polygon that is no rectangle
_SQUARE = 1e-6  # of a rectangle's sides
_MOST_POLYGONS = 2000  # each is looked at in every period
_MOST_CELLS = 16_000_000  # 200 m by 200 m at 5 cm
_CELL = 0.05  # m, as most maps of indoor robots have
_ALIGNED = 1e-6  # cells; what is nearer than this to a cell's rim is there by rounding
_NEITHER = "expected 'polygons', a list of lists of points [x, y] in m, or 'image' and 'resolution'"


class _PolygonFile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A map of polygons."""

    polygons: Annotated[list[Annotated[list[tuple[float, float]], Meta(min_length=3)]], Meta(min_length=1)]
    height: Annotated[float, Meta(gt=0, description="m")] = _HEIGHT


class _GridFile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A map of cells, as nav2's map server reads it."""

    image: Annotated[str, Meta(min_length=1)]
    resolution: Annotated[float, Meta(gt=0, description="m a cell")]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    negate: int | bool = 0
    occupied_thresh: Annotated[float, Meta(ge=0, le=1)] = 0.65
    free_thresh: Annotated[float, Meta(ge=0, le=1)] = 0.25
    mode: str = "trinary"
    height: Annotated[float, Meta(gt=0, description="m")] = _HEIGHT


@dataclass(frozen=True, eq=False)
class FloorMap:
    """What stands on a floor: solid polygons, as high as each other.

    Parameters
    ----------
    polygons
        Corners in order, each of shape (k, 2), m, inertial frame.
    height
        m, from the floor.

    Raises
    ------
    ShapeError, ValueRangeError
        If a polygon has fewer than three corners, no area, or crosses itself, or the height is not positive.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> column = dqc.geometry.FloorMap([[[1, 0], [1.4, 0], [1.4, 0.4], [1, 0.4]]])
    >>> column.clearance([[0, 0], [1.2, 0.1]]).round(3).tolist()
    [1.0, -0.1]
    """

    polygons: tuple[Array, ...]
    height: float = _HEIGHT
    _edges: Array = field(init=False, repr=False)  # (E, 4), of all polygons
    _firsts: NDArray[np.intp] = field(init=False, repr=False)  # number of the first edge of each polygon

    def __post_init__(self) -> None:
        polygons = tuple(_polygon(f"polygons[{i}]", each) for i, each in enumerate(self.polygons))
        edges = [np.hstack([each, np.roll(each, -1, axis=0)]) for each in polygons]
        firsts = np.cumsum([0, *(len(each) for each in edges[:-1])], dtype=np.intp)
        vars(self).update(polygons=polygons, height=as_positive("height", self.height))
        vars(self).update(_edges=np.vstack(edges) if edges else np.zeros((0, 4)), _firsts=firsts)

    def clearance(self, points: ArrayLike) -> Array:
        """Return how far points (N, 2), m, are from the nearest polygon, shape (N,); negative inside one."""
        p = as_array("points", points, (None, 2))
        if not len(self._edges):
            return np.full(len(p), np.inf)
        a, b = self._edges[:, :2], self._edges[:, 2:]
        along, away = b - a, p[:, None] - a
        share = np.clip(
            (away * along).sum(axis=2) / np.maximum((along * along).sum(axis=1), 1e-300), 0.0, 1.0
        )
        least = np.linalg.norm(away - share[..., None] * along, axis=2).min(axis=1)
        return np.where(self.holds(p), -least, least)

    def holds(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether points (N, 2), m, are inside a polygon, shape (N,)."""
        p = as_array("points", points, (None, 2))
        if not len(self._edges):
            return np.zeros(len(p), dtype=bool)
        a, b = self._edges[:, :2], self._edges[:, 2:]
        rises = (a[:, 1] > p[:, 1:]) != (b[:, 1] > p[:, 1:])
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = a[:, 0] + (p[:, 1:] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        crossed = (rises & (p[:, :1] < crossing)).astype(np.int64)
        return (np.add.reduceat(crossed, self._firsts, axis=1) % 2 == 1).any(axis=1)

    def line_clearance(self, start: ArrayLike, ends: ArrayLike) -> Array:
        """Return the distance of straight lines from a point (2,) to others (N, 2), m, from all polygons, shape (N,).

        It is 0 where a line crosses an edge or begins inside a polygon.
        """
        p, q = as_array("start", start, (2,)), as_array("ends", ends, (None, 2))
        if not len(self._edges):
            return np.full(len(q), np.inf)
        a, b = self._edges[:, :2], self._edges[:, 2:]
        least = np.minimum(np.abs(self.clearance(q)), abs(self.clearance(p[None])[0]))
        way = q - p
        for corner in (a, b):
            away = corner - p
            share = (way @ away.T) / np.maximum((way * way).sum(axis=1), 1e-300)[:, None]
            near = np.clip(share, 0.0, 1.0)[..., None] * way[:, None]
            least = np.minimum(least, np.linalg.norm(away - near, axis=2).min(axis=1))
        edge = b - a
        side_p, side_q = _cross(edge, p - a), _cross(edge, q[:, None] - a)
        side_a, side_b = _cross(way[:, None], a - p), _cross(way[:, None], b - p)
        crosses = ((side_p * side_q < 0) & (side_a * side_b < 0)).any(axis=1)
        return np.where(crosses | self.holds(p[None])[0], 0.0, least)

    def boxes(self) -> list[Box]:
        """Return shapes that stand for the polygons: a rectangle is a box, of others each edge is a thin wall."""
        found = []
        for corners in self.polygons:
            sides = np.roll(corners, -1, axis=0) - corners
            scale = float(np.abs(sides).max())
            closed = np.abs(sides[0] + sides[2]).max() < _SQUARE * scale if len(corners) == 4 else False
            if closed and abs(sides[0] @ sides[1]) < _SQUARE * scale * scale:
                found.append(self._box(corners.mean(axis=0), sides[0], float(np.linalg.norm(sides[1]))))
            else:
                found += [
                    self._box(a + 0.5 * side, side, _EDGE) for a, side in zip(corners, sides, strict=True)
                ]
        return found

    def _box(self, middle: Array, side: Array, width: float) -> Box:
        turn = 0.5 * math.atan2(side[1], side[0])
        place = algebra.pose([math.cos(turn), 0, 0, math.sin(turn)], [*middle, 0.5 * self.height])
        return Box(place, np.array([float(np.linalg.norm(side)), width, self.height]))


def load_map(path: str | Path, height: float | None = None) -> FloorMap:
    """Return the map of a YAML file.

    Either it has ``polygons``, lists of points [x, y] in m, and perhaps ``height``; or it is that of a grid, as ROS's
    map server writes it: ``image`` (PNG or PGM, beside the file), ``resolution`` (m a cell), ``origin`` [x, y, yaw] of
    the lower left corner, ``negate``, ``occupied_thresh``. Cells that are not known count as free. A ``height`` given
    here, m, is in place of the file's.

    Raises
    ------
    FileFormatError
        If the file or its image cannot be read, or has no scale.

    Examples
    --------
    >>> import pathlib, tempfile, dqcontrol as dqc
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "room.yaml"
    >>> _ = file.write_text("polygons: [[[1, 0], [2, 0], [2, 1]]]")
    >>> len(dqc.geometry.load_map(file).polygons)
    1
    """
    data = parse_yaml(path, read_text(path))
    if not isinstance(data, dict) or ("polygons" not in data and "image" not in data):
        raise FileFormatError(f"{path}: is no map: {_NEITHER}")
    if "polygons" in data:
        given = convert(path, data, _PolygonFile)
        try:
            return FloorMap(tuple(np.array(each) for each in given.polygons), height or given.height)
        except ValueRangeError as error:
            raise FileFormatError(f"{path}: {error}") from None
    if "resolution" not in data:
        raise FileFormatError(
            f"{path}: resolution: is missing; a map without scale (m a cell) cannot be kept out of"
        )
    grid = convert(path, data, _GridFile)
    found = _of_grid(path, _occupied(path, grid), grid)
    return found if height is None else FloorMap(found.polygons, height)


def map_version(path: str | Path) -> tuple[tuple[int, int, int], ...]:
    """Return what tells a map from another that its files had before: of the file and, of a grid, of its image."""
    data = parse_yaml(path, read_text(path))
    image = data.get("image") if isinstance(data, dict) else None
    return version(path), version(Path(path).parent / str(image))


def save_map(floor: FloorMap, image: str | Path, resolution: float = _CELL, *, force: bool = False) -> Path:
    """Write a map as ROS's map server reads it: an image, and a YAML file of its name beside it; return that.

    A cell is occupied if something stands in any part of it, all others are free; `load_map` reads it again.

    Parameters
    ----------
    floor
        The map.
    image
        New file, PGM or PNG.
    resolution
        m a cell.
    force
        Replace existing files.

    Raises
    ------
    ShapeError, ValueRangeError, FileFormatError, ExistsError
        If nothing stands there, it has too many cells, the suffix is another one, or a file exists already.

    Examples
    --------
    >>> import pathlib, tempfile, dqcontrol as dqc
    >>> column = dqc.geometry.FloorMap([[[1, 0], [1.4, 0], [1.4, 0.4], [1, 0.4]]])
    >>> written = dqc.geometry.save_map(column, pathlib.Path(tempfile.mkdtemp()) / "room.pgm")
    >>> dqc.geometry.load_map(written).clearance([[0, 0], [1.2, 0.1]]).round(3).tolist()
    [1.0, -0.1]
    """
    file, size = Path(image), as_positive("resolution", resolution)
    if file.suffix.lower() not in (".pgm", ".png"):
        raise FileFormatError(f"{file}: a map's image is a .pgm or .png, got '{file.suffix}'")
    if not floor.polygons:
        raise ShapeError("floor: nothing stands on it, so its map has no cells")
    corners = np.vstack(floor.polygons) / size
    low = np.floor(corners.min(axis=0) + _ALIGNED).astype(int) - 1
    columns, rows = np.ceil(corners.max(axis=0) - _ALIGNED).astype(int) + 1 - low
    if columns * rows > _MOST_CELLS:
        raise ValueRangeError(
            f"resolution: {size:g} m makes {columns * rows:,} cells of it, at most {_MOST_CELLS:,}"
        )
    shade = np.where(_touched(floor, low, columns, rows, size), 0, 254).astype(np.uint8)[::-1]
    description = file.with_suffix(".yaml")
    for path in (file, description):
        if path.exists() and not force:
            raise ExistsError(f"{path}: exists already")
    numbers = {
        "image": file.name,
        "mode": "trinary",
        "resolution": size,
        "origin": [*(size * low).tolist(), 0.0],
    }
    numbers |= {"negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196, "height": floor.height}
    with writing(file), whole_file(file, overwrite=force) as draft:
        draft.write_bytes(_image(shade, file.suffix.lower()))
    with writing(description), whole_file(description, overwrite=force) as draft:
        draft.write_text(yaml_text(numbers), encoding="utf-8")
    return description


def _image(shade: NDArray[np.uint8], suffix: str) -> bytes:
    """Return grey cells, the highest row first, as a file's contents."""
    if suffix == ".pgm":
        return f"P5\n{shade.shape[1]} {shade.shape[0]}\n255\n".encode() + shade.tobytes()
    from io import BytesIO

    from matplotlib.image import imsave

    out = BytesIO()
    imsave(out, np.repeat(shade[..., None], 3, axis=2), format="png")
    return out.getvalue()


def _touched(
    floor: FloorMap, low: NDArray[np.intp], columns: int, rows: int, size: float
) -> NDArray[np.bool_]:
    """Return which cells something stands in, shape (rows, columns), the lowest row first."""
    found = np.zeros((rows, columns), dtype=bool)
    x = size * (low[0] + 0.5 + np.arange(columns))
    half = 0.5 * size * (1 - _ALIGNED)  # what only touches a cell's rim is beside it
    for row in range(rows):
        y = size * (low[1] + 0.5 + row)
        heights = floor._edges[:, 1::2]
        near = (heights.min(axis=1) < y + half) & (heights.max(axis=1) > y - half)
        for x1, y1, x2, y2 in floor._edges[near]:
            across = np.abs((y2 - y1) * (x - x1) - (x2 - x1) * (y - y1))
            found[row] |= (
                (across < half * (abs(y2 - y1) + abs(x2 - x1)))
                & (x + half > min(x1, x2))
                & (x - half < max(x1, x2))
            )
        found[row] |= floor.holds(np.column_stack([x, np.full(columns, y)]))
    return found


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _polygon(name: str, corners: ArrayLike) -> Array:
    found = as_array(name, corners, (None, 2))
    if found.ndim != 2 or len(found) < 3:
        raise ShapeError(f"{name}: expected at least three corners, shape (k, 2), got {found.shape}")
    after = np.roll(found, -1, axis=0)
    if abs((found[:, 0] * after[:, 1] - after[:, 0] * found[:, 1]).sum()) < 1e-12:
        raise ValueRangeError(f"{name}: has no area")
    if (pair := _crossing_sides(found)) is not None:
        i, j = pair
        raise ValueRangeError(
            f"{name}: crosses itself: the sides from corner {i + 1} and from corner {j + 1}; what is inside of it is "
            "not clear: order the corners along its rim, or give two polygons"
        )
    return found


def _crossing_sides(corners: Array) -> tuple[int, int] | None:
    """Return two sides of a polygon that cross, None if there are none; those that only touch do not."""
    side = np.roll(corners, -1, axis=0) - corners
    turns = _cross(side, np.roll(side, -1, axis=0))
    if len(corners) <= 4 and ((turns >= 0).all() or (turns <= 0).all()):
        return None
    to = corners[None] - corners[:, None]  # from the first corner of side i to corner j
    first = _cross(side[:, None], to)
    # side j has its ends on both sides of the line of side i
    apart = first * np.roll(first, -1, axis=1) < 0.0
    found = np.argwhere(apart & apart.T)
    return (int(found[0, 0]), int(found[0, 1])) if len(found) else None


def _occupied(path: str | Path, grid: _GridFile) -> NDArray[np.bool_]:
    """Return which cells are occupied, the lowest row first."""
    from matplotlib.image import imread

    file = Path(path).parent / grid.image
    try:
        image = np.asarray(imread(file))
    except (OSError, ValueError, SyntaxError) as error:
        raise FileFormatError(f"{path}: image: {file} cannot be read: {error}") from None
    if image.shape[0] * image.shape[1] > _MOST_CELLS:
        raise FileFormatError(
            f"{path}: image: has {image.shape[0] * image.shape[1]} cells, at most {_MOST_CELLS}"
        )
    largest = np.iinfo(image.dtype).max if image.dtype.kind in "iu" else 1.0
    if image.ndim == 3:
        image = image[..., :3].mean(axis=2)
    shade = image.astype(np.float64) / largest
    occupied = shade if grid.negate else 1.0 - shade
    return (occupied > grid.occupied_thresh)[::-1]


def _of_grid(path: str | Path, occupied: NDArray[np.bool_], grid: _GridFile) -> FloorMap:
    """Return a map of rectangles that cover the occupied cells exactly: runs of cells, joined with equal runs above."""
    size, (x0, y0, yaw) = grid.resolution, grid.origin
    open_runs: dict[tuple[int, int], int] = {}  # where each began
    blocks = []
    for row in range(len(occupied) + 1):
        line = occupied[row] if row < len(occupied) else np.zeros(occupied.shape[1], bool)
        steps = np.flatnonzero(np.diff(np.r_[False, line, False].astype(int)))
        runs = set(zip(steps[::2].tolist(), steps[1::2].tolist(), strict=True))
        blocks += [(run, begun, row) for run, begun in open_runs.items() if run not in runs]
        open_runs = {run: open_runs.get(run, row) for run in runs}
    if len(blocks) > _MOST_POLYGONS:
        raise FileFormatError(
            f"{path}: has {len(blocks)} blocks of occupied cells, at most {_MOST_POLYGONS} are kept out of; clean it up"
        )
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    corners = (
        size * np.array([[a, low], [b, low], [b, high], [a, high]], dtype=np.float64)
        for (a, b), low, high in sorted(blocks)
    )
    return FloorMap(tuple(each @ turn.T + [x0, y0] for each in corners), grid.height)
