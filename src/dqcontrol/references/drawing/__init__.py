"""Drawings as references."""

from dqcontrol.references.drawing.drawing import Drawing
from dqcontrol.references.drawing.drawing_file import DrawingFile, load_drawing, parse_drawing

__all__ = [
    "Drawing",
    "DrawingFile",
    "load_drawing",
    "parse_drawing",
]
