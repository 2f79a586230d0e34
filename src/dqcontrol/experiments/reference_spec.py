"""References as a spec describes them: relative to where the hand starts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol import references as shapes
from dqcontrol.errors import ValueRangeError, as_array

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Positive = Annotated[float, Meta(gt=0)]
Plane = Annotated[
    Literal["xy", "xz", "yz"] | tuple[Vector, Vector],
    Meta(description="base axes, or two perpendicular vectors: to the right and up"),
]


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all parts of a spec."""


class StartPose(Part, frozen=True, kw_only=True):
    """Where the reference starts, base frame; what is left out is the hand's at the start configuration."""

    position: Annotated[Vector | None, Meta(description="m")] = None
    quaternion: Annotated[tuple[float, float, float, float] | None, Meta(description="scalar first")] = None


class Offset(Part, frozen=True, kw_only=True):
    """A displacement of the start pose, base axes: so far is the hand from its target when the run starts."""

    translation: Annotated[Vector, Meta(description="m")] = (0.0, 0.0, 0.0)
    rotation: Annotated[Vector, Meta(description="rotation vector, rad")] = (0.0, 0.0, 0.0)


class ReferenceSpec(Part, frozen=True, kw_only=True, tag_field="kind"):
    """A reference; subclasses say which."""

    start: StartPose = StartPose()
    offset: Offset = Offset()

    def build(self, hand: Array, folder: Path) -> shapes.Reference:
        """Return the reference.

        Parameters
        ----------
        hand
            Pose of the hand at the start configuration, shape (8,), inertial frame.
        folder
            Where relative file names start.
        """
        raise NotImplementedError

    def _start(self, hand: Array) -> Array:
        rotation, position = algebra.rotation(hand), algebra.translation(hand)
        if self.start.position is not None:
            position = as_array("reference.start.position", self.start.position, (3,))
        if self.start.quaternion is not None:
            rotation = as_array("reference.start.quaternion", self.start.quaternion, (4,))
            if abs(np.linalg.norm(rotation) - 1) > 1e-3:
                raise ValueRangeError(
                    f"reference.start.quaternion: must have norm 1, got {np.linalg.norm(rotation):.6g}"
                )
            rotation = rotation / np.linalg.norm(rotation)
        angle = as_array("reference.offset.rotation", self.offset.rotation, (3,))
        turn = algebra.exp_body(np.concatenate([angle / 2, np.zeros(3)]))
        turned = algebra.multiply(turn, np.concatenate([rotation, np.zeros(4)]))[:4]
        moved = position + as_array("reference.offset.translation", self.offset.translation, (3,))
        return algebra.pose(turned, moved)


class SetPointSpec(ReferenceSpec, frozen=True, kw_only=True, tag="set-point"):
    """Rest at the start pose."""

    def build(self, hand: Array, folder: Path) -> shapes.Reference:
        """Return the set-point."""
        return shapes.SetPoint(self._start(hand))


class CircleSpec(ReferenceSpec, frozen=True, kw_only=True, tag="circle"):
    """Run around a circle; see `dqcontrol.references.Circle`."""

    radius: Annotated[float, Meta(gt=0, description="m")]
    duration: Annotated[float, Meta(gt=0, description="s")]
    plane: Plane = "xz"
    turns: Positive = 1.0
    clockwise: bool = True

    def build(self, hand: Array, folder: Path) -> shapes.Reference:
        """Return the circle."""
        return shapes.Circle(
            self._start(hand),
            radius=self.radius,
            duration=self.duration,
            plane=self.plane,
            turns=self.turns,
            clockwise=self.clockwise,
        )


class SpiralSpec(ReferenceSpec, frozen=True, kw_only=True, tag="spiral"):
    """Circle around an axis while moving along it; see `dqcontrol.references.Spiral`."""

    radius: Annotated[float, Meta(gt=0, description="m")]
    length: Annotated[float, Meta(description="m")]
    duration: Annotated[float, Meta(gt=0, description="s")]
    axis: Literal["x", "y", "z"] | Vector = "y"
    turns: Positive = 3.0
    clockwise: bool = True

    def build(self, hand: Array, folder: Path) -> shapes.Reference:
        """Return the spiral."""
        return shapes.Spiral(
            self._start(hand),
            radius=self.radius,
            length=self.length,
            duration=self.duration,
            axis=self.axis,
            turns=self.turns,
            clockwise=self.clockwise,
        )


class SquareSpec(ReferenceSpec, frozen=True, kw_only=True, tag="square"):
    """Run around a square; see `dqcontrol.references.Square`."""

    side: Annotated[float, Meta(gt=0, description="m")]
    duration: Annotated[float, Meta(gt=0, description="s")]
    shares: tuple[Positive, Positive, Positive, Positive] = (1.0, 1.0, 1.0, 1.0)
    plane: Plane = "xz"
    clockwise: bool = True

    def build(self, hand: Array, folder: Path) -> shapes.Reference:
        """Return the square."""
        return shapes.Square(
            self._start(hand),
            side=self.side,
            duration=self.duration,
            shares=self.shares,
            plane=self.plane,
            clockwise=self.clockwise,
        )


class DrawingSpec(ReferenceSpec, frozen=True, kw_only=True, tag="drawing"):
    """Follow a drawing file; see `dqcontrol.references.load_drawing`."""

    file: Annotated[str, Meta(min_length=1, description="path, relative to the spec")]

    def build(self, hand: Array, folder: Path) -> shapes.Reference:
        """Return the drawing."""
        return shapes.load_drawing(folder / self.file, self._start(hand))


AnyReference = SetPointSpec | CircleSpec | SpiralSpec | SquareSpec | DrawingSpec
