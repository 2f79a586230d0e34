"""Figures of panels that are quick to draw: margins from the extents of their texts, axes in a few strokes.

Matplotlib makes five artists of each tick and lays a figure out by drawing it several times: of the six figures of a
run that was two thirds of the time. An axis here draws grid and ticks in a stroke each and its numbers as they are, and
a figure moves its panels once, so that what stands beside them has room. Ticks that somebody asks for, as by
``get_xticklabels``, are Matplotlib's own from then on.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import text_to_path
from matplotlib.ticker import NullLocator
from matplotlib.transforms import Bbox, IdentityTransform

from dqcontrol.arrays import Array
from dqcontrol.figures.paths import outline
from dqcontrol.figures.save import encoded
from dqcontrol.figures.style import TICKS

_PAD, _GAP = 0.06, 0.12  # in: around everything, and between the labels of neighbouring panels
_TICK, _BESIDE = 3.5, 7.0  # points: length of ticks, distance of numbers from the panel, as Matplotlib's
_MINOR = 2.0  # points
_SIZE = 8.0  # points, of numbers where nothing else is said
_DIGIT = 0.73  # height of a digit of DejaVu Sans as a share of its size
_ROUNDING = 0.1  # px
_PASSES = 2  # ticks, and so the widths of their numbers, may change with the size of the panel


class PanelFigure(Figure):
    """A figure whose panels make room for their labels, and that notebooks show sharp and as wide as on paper."""

    def add_subplot(self, *args: Any, **options: Any) -> Any:
        """Add a panel; see Matplotlib's method."""
        if not {"projection", "axes_class"} & options.keys():
            options["axes_class"] = PanelAxes
        return super().add_subplot(*args, **options)

    def draw(self, renderer: Any) -> None:
        """Draw everything."""
        if self.get_layout_engine() is None:
            before, panels = None, cast(list[Any], self.axes)
            for _ in range(_PASSES):
                numbers = [
                    axis.own_depth() for axes in panels for axis in (axes.xaxis, axes.yaxis) if _is_seen(axis)
                ]
                if numbers == before:
                    break
                before = numbers
                _make_room(self, renderer)
        super().draw(renderer)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        width, height = (round(96 * inches) for inches in self.get_size_inches())
        return encoded(self, "png"), {"width": width, "height": height}


class _PanelAxis:
    """What both axes of a panel share."""

    _marked: Any = None  # what the marks in `_found` depend on
    depth = 0.0  # px: how far the label stands at least from the panel; one number for a column

    def __init__(self: Any, *args: Any, **options: Any) -> None:
        self.majorTicks, self.minorTicks = [], []
        super().__init__(*args, **options)

    def reset_ticks(self: Any) -> None:
        """Make no tick before somebody asks for one."""
        self.majorTicks, self.minorTicks = [], []

    def get_ticks_position(self: Any) -> Any:
        """Return on which side ticks are, which Matplotlib reads off its own."""
        return cast(Any, super()).get_ticks_position() if self.majorTicks else self.side

    def draw(self: Any, renderer: Any) -> None:
        """Draw grid, ticks, numbers and label."""
        if self.majorTicks or self.minorTicks:
            cast(Any, super()).draw(renderer)
            return
        if not self.get_visible():
            return
        look = self._look()
        places, numbers, minor = self._marks()
        box, scale = self.axes.bbox, renderer.points_to_pixels(1.0)
        if look.get("gridOn", False):
            self._strokes(
                renderer, places, box.extents[self.across], box.extents[self.across + 2], look, "grid_"
            )
        if look.get(self.side, True):
            edge = box.extents[self.across]
            for at, length in ((places, _TICK), (minor, _MINOR)):
                self._strokes(renderer, at, edge, edge - length * scale, look, "")
        if look.get(f"label{self.side}", True):
            self._numbers(renderer, places, numbers, look)
        self._place_label(renderer)
        self.label.draw(renderer)
        self.offsetText.draw(renderer)
        self.stale = False

    def get_tightbbox(self: Any, renderer: Any = None, *, for_layout_only: bool = False) -> Any:
        """Return what numbers and label take up, px."""
        if self.majorTicks or self.minorTicks:
            return cast(Any, super()).get_tightbbox(renderer, for_layout_only=for_layout_only)
        if not self.get_visible():
            return None
        renderer = renderer or self.get_figure(root=True)._get_renderer()
        self._place_label(renderer)
        boxes = [self._numbers_box()]
        for text in (self.label, self.offsetText):
            if text.get_visible() and text.get_text():
                box = text.get_window_extent(renderer)
                if for_layout_only and text is self.label:
                    # A longer one would gain nothing by a smaller panel.
                    low, high = box.min, box.max
                    low[1 - self.across] = high[1 - self.across] = 0.5 * (low + high)[1 - self.across]
                    box = Bbox([low, high])
                boxes.append(box)
        return Bbox.union(boxes)

    def own_depth(self: Any) -> float:
        """Return how far numbers reach from the panel, px."""
        return self.axes.bbox.extents[self.across] - self._numbers_box().extents[self.across]

    def _look(self: Any) -> dict[str, Any]:
        return {"labelsize": _SIZE, **TICKS, **self.get_tick_params()}

    def _marks(self: Any) -> tuple[Array, list[str], Array]:
        """Return where ticks are, px, with their numbers, and where minor ones are."""
        low, high = sorted(self.get_view_interval())
        place = (low, high, *self.axes.bbox.extents, self.major.locator, self.major.formatter)
        if self._marked != place:
            self._marked, self._found, self._boxes = place, self._new_marks(low, high), {}
        return self._found

    def _new_marks(self: Any, low: float, high: float) -> tuple[Array, list[str], Array]:
        major = np.asarray(self.get_majorticklocs(), dtype=np.float64)
        numbers = self.get_major_formatter().format_ticks(major)
        places, extents = self._pixels(major), self.axes.bbox.extents
        first, last = extents[1 - self.across], extents[3 - self.across]
        seen = (places > first - _ROUNDING) & (places < last + _ROUNDING)
        self.offsetText.set_text(self.get_major_formatter().get_offset())
        minor = np.empty(0)
        if not isinstance(self.get_minor_locator(), NullLocator):
            minor = np.asarray(self.get_minorticklocs(), dtype=np.float64)
            minor = minor[(minor >= low) & (minor <= high)]
        texts = [number for number, is_seen in zip(numbers, seen, strict=True) if is_seen]
        return places[seen], texts, self._pixels(minor)

    def _pixels(self: Any, values: Array) -> Array:
        if not len(values):
            return values
        points = np.zeros((len(values), 2))
        points[:, 1 - self.across] = values
        transform = self.axes.get_yaxis_transform() if self.across == 0 else self.axes.get_xaxis_transform()
        return transform.transform(points)[:, 1 - self.across]

    def _strokes(
        self: Any, renderer: Any, places: Array, start: float, end: float, look: dict[str, Any], kind: str
    ) -> None:
        """Draw lines across the axis, all in one path."""
        if not len(places):
            return
        vertices = np.empty((2 * len(places), 2))
        vertices[:, 1 - self.across] = np.repeat(places, 2)
        vertices[:, self.across] = np.tile([start, end], len(places))
        codes = np.tile(np.array([Path.MOVETO, Path.LINETO], dtype=Path.code_type), len(places))
        pen = renderer.new_gc()
        pen.set_foreground(look[f"{kind}color"])
        pen.set_linewidth(look.get(f"{kind}linewidth", 0.8))
        renderer.draw_path(pen, Path(vertices, codes), IdentityTransform())
        pen.restore()

    def _numbers(self: Any, renderer: Any, places: Array, numbers: list[str], look: dict[str, Any]) -> None:
        size = look["labelsize"]
        font, scale = _font(size), renderer.points_to_pixels(1.0)
        pen = renderer.new_gc()
        pen.set_foreground(look["labelcolor"])
        edge = self.axes.bbox.extents[self.across] - _BESIDE * scale
        high = renderer.get_canvas_width_height()[1]
        for place, text in zip(places, numbers, strict=True):
            plain, math = self.label._preprocess_math(text)
            width = _width(text, size) * scale
            if self.across == 0:
                x, y = edge - width, place - 0.5 * _DIGIT * size * scale
            else:
                x, y = place - 0.5 * width, edge - _DIGIT * size * scale
            renderer.draw_text(pen, x, high - y if renderer.flipy() else y, plain, font, 0.0, ismath=math)
        pen.restore()

    def _numbers_box(self: Any) -> Bbox:
        """Return what the numbers take up, px; where there are none, a line of the panel's edge."""
        look = self._look()
        self._marks()
        key = (look.get(f"label{self.side}", True), look["labelsize"])
        if key not in self._boxes:
            self._boxes[key] = self._new_numbers_box(look)
        return self._boxes[key]

    def _new_numbers_box(self: Any, look: dict[str, Any]) -> Bbox:
        box = self.axes.bbox
        low, high = box.min.copy(), box.max.copy()
        high[self.across] = low[self.across]
        if look.get(f"label{self.side}", True):
            places, numbers, _ = self._marks()
            scale = self.get_figure(root=True).dpi / 72
            size = look["labelsize"]
            widths = scale * np.array([_width(text, size) for text in numbers])
            half = 0.5 * (widths if self.across else np.full(len(widths), size * scale))
            if len(widths):
                along = 1 - self.across
                low[along] = min(low[along], (places - half).min())
                high[along] = max(high[along], (places + half).max())
                deep = size * scale if self.across else widths.max()
                low[self.across] -= _BESIDE * scale + deep
        return Bbox([low, high])

    def _place_label(self: Any, renderer: Any) -> None:
        """Put the label outside of the numbers, and the power of ten, if there is one, at the end of the axis."""
        scale = renderer.points_to_pixels(1.0)
        edge = self.axes.bbox.extents[self.across] - max(self.depth, self.own_depth())
        if self.across == 0:
            self.label.set_x(edge - self.labelpad * scale)
            self.offsetText.set_position((0, self.axes.bbox.y1 + self.OFFSETTEXTPAD * scale))
        else:
            self.label.set_y(edge - self.labelpad * scale)
            self.offsetText.set_position((1, edge - self.OFFSETTEXTPAD * scale))


class _PanelXAxis(_PanelAxis, XAxis):
    across, side = 1, "bottom"


class _PanelYAxis(_PanelAxis, YAxis):
    across, side = 0, "left"


class PanelAxes(Axes):
    """A panel; long curves keep their peaks, and no more points than can be seen."""

    def _init_axis(self) -> None:
        self.xaxis, self.yaxis = _PanelXAxis(self, clear=False), _PanelYAxis(self, clear=False)
        for axis, sides in ((self.xaxis, ("bottom", "top")), (self.yaxis, ("left", "right"))):
            for side in sides:
                self.spines[side].register_axis(axis)

    def clear(self) -> None:
        """Remove everything; see Matplotlib's method."""
        super().clear()
        for spine in self.spines.values():
            spine.get_spine_transform()  # finds its place, which else happens as ticks are made

    def plot(self, *args: Any, **options: Any) -> Any:
        """Draw curves; see Matplotlib's method."""
        lines = super().plot(*args, **options)
        for line in lines:
            x, y = map(np.asarray, line.get_data(orig=False))
            kept = outline(y.astype(np.float64)[:, None])
            if kept is not None and (np.diff(x) >= 0).all():
                line.set_data(x[kept], y[kept])
        return lines


@lru_cache
def _font(size: float) -> FontProperties:
    return FontProperties(size=size)


@lru_cache(maxsize=4096)
def _width(text: str, size: float) -> float:
    """Return the width of a text, points."""
    math = text.count("$") >= 2
    return text_to_path.get_text_width_height_descent(text, _font(size), math)[0] if text else 0.0


def _make_room(figure: Figure, renderer: Any) -> None:
    """Move panels so that what stands beside them fits on the paper, and not over each other."""
    panels: list[Any] = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    if not panels:
        return
    dpi, (width, height) = figure.dpi, figure.bbox.size
    rows, columns = panels[0].get_subplotspec().get_geometry()[:2]
    for column in range(columns):
        mine = [each.yaxis for each in panels if each.get_subplotspec().colspan.start == column]
        mine = [each for each in mine if _is_seen(each)]
        deepest = max((each.own_depth() for each in mine), default=0.0)
        for each in mine:
            each.depth = deepest
    beside = np.zeros((4, rows, columns))  # px: to the left, below, to the right, above
    for axes in panels:
        place = axes.get_subplotspec()
        if axes.get_visible() and place is not None:
            beside[:, place.rowspan.start, place.colspan.start] = _beside(axes, renderer)
    left, below, right, above = beside
    pad, gap = _PAD * dpi, _GAP * dpi
    foot = max((each.get_window_extent(renderer).height + pad for each in figure.legends), default=0.0)
    head = max((each.get_window_extent(renderer).height + pad for each in figure.texts), default=0.0)
    across = [pad + left[:, 0].max(), *(right[:, :-1].max(axis=0) + left[:, 1:].max(axis=0) + gap)]
    up = [foot + pad + below[-1].max(), *(below[:-1].max(axis=1) + above[1:].max(axis=1) + gap)[::-1]]
    wide = (width - sum(across) - right[:, -1].max() - pad) / columns
    high = (height - sum(up) - above[0].max() - pad - head) / rows
    if min(wide, high) <= 0:  # so small a figure that nothing helps
        return
    for axes in panels:
        place = axes.get_subplotspec()
        column, row = place.colspan.start, rows - 1 - place.rowspan.start  # rows count from above
        x, y = sum(across[: column + 1]) + column * wide, sum(up[: row + 1]) + row * high
        axes.set_position((x / width, y / height, wide / width, high / height))
        axes.set_in_layout(True)  # which the line before has taken away


def _is_seen(axis: Any) -> bool:
    return hasattr(axis, "own_depth") and axis.axes.get_visible() and axis.axes.axison and not axis.majorTicks


def _beside(axes: Any, renderer: Any) -> Array:
    """Return how far axes reach beyond their panel to the left, below, to the right and above, px."""
    if axes.name == "3d":
        return np.zeros(4)  # all is inside
    axes.apply_aspect()
    box = axes.bbox
    boxes = [box]
    if axes.axison:
        boxes += [axis.get_tightbbox(renderer, for_layout_only=True) for axis in (axes.xaxis, axes.yaxis)]
    axes._update_title_position(renderer)
    texts = [axes.title, *(getattr(axes, f"_{side}_title") for side in ("left", "right"))]
    boxes += [each.get_window_extent(renderer) for each in texts if each.get_text()]
    if axes.get_legend() is not None:
        boxes.append(axes.get_legend().get_window_extent(renderer))
    every = np.array([each.extents for each in boxes if each is not None])
    low, high = every[:, :2].min(axis=0), every[:, 2:].max(axis=0)
    return np.concatenate([box.min - low, high - box.max])
