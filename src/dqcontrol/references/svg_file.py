"""SVG drawings as pen strokes: every path becomes lines and arcs whose tangents agree, needing svgelements."""

from __future__ import annotations

import cmath
import io
import os
import warnings
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from dqcontrol.errors import FileFormatError, NoteWarning, from_extra
from dqcontrol.files.input_file import read_whole
from dqcontrol.references.strokes import Arc, PenStroke, StraightStroke, Stroke

_LARGEST = 2_000_000  # bytes
_MOST_STROKES = 20_000  # more are a picture, no drawing
_PIECES = 12  # pairs of arcs for each curve of a path
_STEP = 1e-5  # of a curve's parameter, for its tangents
_WHITE = "#ffffff"
_EDGE = 0.01  # of the page: a background may end so far from its edge
_FLAT = 1e-6  # of a chord's length: an arc as flat as that is a line


def load_svg(path: str | os.PathLike[str]) -> tuple[PenStroke, ...]:
    """Return the outlines of all shapes of an SVG file, in its own units, y up, at speed 1.

    Lines, curves, rectangles, circles, ellipses and polygons count, with their transformations; width and colour do
    not. Curves become pairs of arcs that join without a corner. Left out are shapes that nobody sees (hidden ones,
    those with neither fill nor line, white ones without a line), fills of the whole page, texts and images; a
    `NoteWarning` names the last three.

    Parameters
    ----------
    path
        The file, at most 2 MB. A document type that defines entities is refused; a harmless one is passed over, and
        what it names is never read.

    Raises
    ------
    FileFormatError
        If the file is no SVG, is too large, defines entities or uses within uses, or holds no path.
    MissingExtraError
        If svgelements is not installed.
    """
    content = _read(path)
    svg = from_extra("svgelements", "paint", "SVG drawings")
    try:
        document = svg.SVG.parse(io.BytesIO(content), reify=True)
        elements = list(document.elements())
        size = document.width, document.height
        seen = [e for e in elements if isinstance(e, svg.Shape) and _is_seen(e)]
        pages = [e for e in seen if len(seen) > 1 and _covers(e, *map(float, size))]
        shapes = [svg.Path(e) for e in seen if e not in pages]
    except (ValueError, TypeError, ZeroDivisionError, AttributeError, IndexError, KeyError) as error:
        raise FileFormatError(f"{path}: svgelements cannot read it: {error}") from None
    left_out = list(_left_out(svg, elements, len(pages)))
    pens: list[PenStroke] = []
    count = 0
    for shape in shapes:
        for part in shape.as_subpaths():
            strokes = tuple(_strokes(part))
            count += len(strokes)
            if count > _MOST_STROKES:
                raise FileFormatError(f"{path}: more than {_MOST_STROKES} strokes; simplify its paths")
            if strokes:
                first = _number(part[0].end)
                pens.append(PenStroke((first.real, first.imag), strokes))
    if not pens:
        why = f" (left out: {', '.join(left_out)})" if left_out else ""
        raise FileFormatError(f"{path}: holds no path to draw; texts must be turned into paths first{why}")
    if left_out:
        warnings.warn(f"{path}: left out: {', '.join(left_out)}", NoteWarning, stacklevel=2)
    return tuple(pens)


def _is_seen(shape: Any) -> bool:
    """Return whether a shape has a line, or a fill that is not white; without a word on either it is filled black."""
    said = shape.values.get("stroke"), shape.values.get("fill")
    stroke = shape.stroke is not None and shape.stroke.value is not None
    fill = shape.fill is None or (shape.fill.value is not None and shape.fill.hexrgb != _WHITE)
    return stroke or fill or said == (None, None)


def _covers(shape: Any, width: float, height: float) -> bool:
    """Return whether a shape without a line fills the whole page, as a background does."""
    if shape.stroke is not None and shape.stroke.value is not None:
        return False
    box = shape.bbox()
    if box is None:
        return False
    left, top, right, bottom = box
    near = _EDGE * max(width, height)
    return left <= near and top <= near and right >= width - near and bottom >= height - near


def _left_out(svg: Any, elements: list[Any], pages: int) -> Iterator[str]:
    texts = [text for e in elements if isinstance(e, svg.Text) if (text := str(e.text or "").strip())]
    if texts:
        named = ", ".join(f"'{text:.20}'" for text in texts[:3]) + ", …" * (len(texts) > 3)
        yield f"text {named} (turn it into paths, in Inkscape: Path, Object to Path)"
    if images := sum(isinstance(e, svg.Image) for e in elements):
        yield "an image" if images == 1 else f"{images} images"
    if pages:
        yield "a background as large as the page"


def _read(path: str | os.PathLike[str]) -> bytes:
    """Return a file's content without its document type and paths that are empty; or refuse it."""
    content = read_whole(path, _LARGEST)

    def refuse(*_: object) -> None:
        raise FileFormatError(
            f"{path}: has a document type that defines entities, which is refused; delete it"
        )

    def look(name: str, system: str | None, public: str | None, inside: bool) -> None:
        if inside:
            refuse()

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = look
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(content, True)
        root = ElementTree.fromstring(content)
    except (expat.ExpatError, ElementTree.ParseError) as error:
        raise FileFormatError(f"{path}: no XML: {error}") from None
    if root.tag.rpartition("}")[2] != "svg":
        raise FileFormatError(f"{path}: expected <svg>, got <{root.tag.rpartition('}')[2]:.40}>")
    # uses of uses can grow without end
    nested = {e.get("id") for e in root.iter() if any(map(_is_use, e.iter()))}
    if any(_target(e) in nested for e in root.iter() if _is_use(e)):
        raise FileFormatError(f"{path}: a <use> of what holds a <use>; flatten the drawing")
    for parent in root.iter():
        for child in list(parent):
            if (
                isinstance(child.tag, str)
                and child.tag.rpartition("}")[2] == "path"
                and not child.get("d", "").strip()
            ):
                parent.remove(child)
    return ElementTree.tostring(root)


def _is_use(element: Any) -> bool:
    return isinstance(element.tag, str) and element.tag.rpartition("}")[2] == "use"


def _target(use: Any) -> str:
    return (use.get("href") or use.get("{http://www.w3.org/1999/xlink}href") or "").removeprefix("#")


def _number(point: Any) -> complex:
    return complex(point.x, -point.y)


def _strokes(part: Any) -> Iterator[Stroke]:
    for segment in part:
        kind = type(segment).__name__
        if kind == "Move":
            continue
        start, end = _number(segment.start), _number(segment.end)
        if kind in ("Line", "Close"):
            if abs(end - start) > 1e-9:
                yield StraightStroke(end.real, end.imag, 1.0)
            continue
        marks = [k / _PIECES for k in range(_PIECES + 1)]
        points = [_number(segment.point(t)) for t in marks]
        if max(abs(p - start) for p in points) < 1e-9:
            continue
        tangents = [_tangent(segment, t) for t in marks]
        for k in range(_PIECES):
            yield from _two_arcs(points[k], tangents[k], points[k + 1], tangents[k + 1])


def _tangent(segment: Any, t: float) -> complex:
    before, after = max(t - _STEP, 0.0), min(t + _STEP, 1.0)
    way = _number(segment.point(after)) - _number(segment.point(before))
    return way / (abs(way) or 1.0)


def _two_arcs(a: complex, u: complex, b: complex, v: complex) -> Iterator[Stroke]:
    """Join two points with unit tangents by two arcs that meet smoothly (K. Bolton, Biarc curves, 1975)."""
    way, both = b - a, u + v
    if abs(way) < 1e-9:
        return
    apart, along = 1.0 - _dot(u, v), _dot(way, both)
    if apart > 1e-9:
        length = (cmath.sqrt(along**2 + 2.0 * apart * abs(way) ** 2).real - along) / (2.0 * apart)
    else:
        length = abs(way) ** 2 / (2.0 * along) if along > 0 else 0.5 * abs(way)
    middle = 0.5 * (a + b + length * (u - v))
    yield from _arc(a, middle, a, u)
    yield from _arc(middle, b, b, v)


def _arc(start: complex, end: complex, touched: complex, tangent: complex) -> Iterator[Stroke]:
    """Return the arc between two points that has this tangent at the one of them that is touched."""
    normal, chord = 1j * tangent, (end if touched == start else start) - touched
    across = _dot(normal, chord)
    if abs(end - start) < 1e-9:
        return
    if abs(across) < _FLAT * abs(chord):
        yield StraightStroke(end.real, end.imag, 1.0)
        return
    radius = abs(chord) ** 2 / (2.0 * across)
    centre = touched + radius * normal
    yield Arc(end.real, end.imag, centre.real, centre.imag, clockwise=radius < 0, speed=1.0)


def _dot(a: complex, b: complex) -> float:
    return (a.conjugate() * b).real
