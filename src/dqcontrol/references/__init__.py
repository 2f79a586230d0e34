"""Desired motions: pose, twist and twist rate over time."""

from collections.abc import Callable
from typing import Any

from dqcontrol.moved import names_moved_from
from dqcontrol.references.circle import Circle, Spiral
from dqcontrol.references.curve import Curve
from dqcontrol.references.drawing import Drawing
from dqcontrol.references.drawing.drawing_file import DrawingFile, load_drawing, parse_drawing
from dqcontrol.references.drive_through import DriveThrough
from dqcontrol.references.drive_to import DriveTo
from dqcontrol.references.jerk_limited import JerkLimited
from dqcontrol.references.points import Points
from dqcontrol.references.points_file import load_points
from dqcontrol.references.previewed import Previewed
from dqcontrol.references.random_goals import random_goals
from dqcontrol.references.reference import Reference
from dqcontrol.references.rigid_motion import motion_samples
from dqcontrol.references.sample import Sample
from dqcontrol.references.sequence import Repeat, Sequence
from dqcontrol.references.set_point import SetPoint
from dqcontrol.references.square import Square
from dqcontrol.references.strokes import Arc, Rest, StraightStroke
from dqcontrol.references.timing import CornerStops, StartRamp
from dqcontrol.references.transformed import Transformed
from dqcontrol.references.via_points import ViaPoints

__all__ = [
    "Arc",
    "Circle",
    "CornerStops",
    "Curve",
    "Drawing",
    "DrawingFile",
    "DriveThrough",
    "DriveTo",
    "JerkLimited",
    "Points",
    "Previewed",
    "Reference",
    "Repeat",
    "Rest",
    "Sample",
    "Sequence",
    "SetPoint",
    "Spiral",
    "Square",
    "StartRamp",
    "StraightStroke",
    "Transformed",
    "ViaPoints",
    "load_drawing",
    "load_points",
    "motion_samples",
    "parse_drawing",
    "random_goals",
]

__getattr__: Callable[[str], Any] = names_moved_from(__name__)
