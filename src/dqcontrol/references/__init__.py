"""Desired motions: pose, twist and twist rate over time."""

from dqcontrol.references.circle import Circle, Spiral
from dqcontrol.references.reference import Reference
from dqcontrol.references.sample import Sample
from dqcontrol.references.set_point import SetPoint
from dqcontrol.references.square import Square

__all__ = ["Circle", "Reference", "Sample", "SetPoint", "Spiral", "Square"]
