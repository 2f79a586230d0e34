"""References as a spec describes them: one structure a kind."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from dqcontrol import references as shapes
from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.spec.reference_base import Array, Part, ReferenceSpec, Vector
from dqcontrol.files.text_file import read_text
from dqcontrol.robots import Robot

__all__ = ["AnyReference", "Part"]

Positive = Annotated[float, Meta(gt=0)]
Plane = Annotated[
    Literal["xy", "xz", "yz"] | tuple[Vector, Vector],
    Meta(description="base axes, or two perpendicular vectors: to the right and up"),
]


class SetPointSpec(ReferenceSpec, frozen=True, kw_only=True, tag="set-point"):
    """Rest at the start pose, for ever or as long as given."""

    duration: Annotated[float, Meta(gt=0, description="s")] | None = None

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        return shapes.SetPoint(start, math.inf if self.duration is None else self.duration)


class DriveToSpec(ReferenceSpec, frozen=True, kw_only=True, tag="drive-to"):
    """Go with the whole robot to the pose that ``start`` and ``offset`` say; see `dqcontrol.references.DriveTo`."""

    share: Annotated[float, Meta(gt=0, le=1, description="of the velocity limits")] = 0.5

    def of_robot(self, reference: shapes.Reference, robot: Robot, start: Array) -> shapes.Reference:
        """Return the way from the start configuration to the reference's pose."""
        return shapes.DriveTo.pose(robot, start, reference.at(0.0).pose, self.share)

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        if where != "reference":
            raise ValueRangeError(
                f"{where}: drive-to starts where the robot does, so it is no part of a sequence"
            )
        return shapes.SetPoint(start)


class CircleSpec(ReferenceSpec, frozen=True, kw_only=True, tag="circle"):
    """Run around a circle; see `dqcontrol.references.Circle`."""

    radius: Annotated[float, Meta(gt=0, description="m")]
    duration: Annotated[float, Meta(gt=0, description="s")]
    plane: Plane = "xz"
    turns: Positive = 1.0
    clockwise: bool = True

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        return shapes.Circle(
            start,
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

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        return shapes.Spiral(
            start,
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

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        return shapes.Square(
            start,
            side=self.side,
            duration=self.duration,
            shares=self.shares,
            plane=self.plane,
            clockwise=self.clockwise,
        )


class DrawingSpec(ReferenceSpec, frozen=True, kw_only=True, tag="drawing"):
    """Follow a drawing file; see `dqcontrol.references.load_drawing`."""

    file: Annotated[str, Meta(min_length=1, description="path, relative to the spec")]

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        file = shapes.parse_drawing(read_text(folder / self.file), str(folder / self.file))
        if file.position is not None:
            self._refuse(0, where, folder / self.file, "where it starts")
        if file.rotation is not None:
            self._refuse(1, where, folder / self.file, "how the hand is turned")
        return file.drawing(start)


class PointsSpec(ReferenceSpec, frozen=True, kw_only=True, tag="points"):
    """Run from pose to pose of a file; see `dqcontrol.references.load_points`."""

    file: Annotated[str, Meta(min_length=1, description="path, relative to the spec")]
    duration: Annotated[float, Meta(gt=0, description="s")] | None = None

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        return self._points(start, folder, where)

    def _points(self, start: Array, folder: Path, where: str) -> shapes.Points:
        file = folder / self.file
        self._refuse(0, where, file, "where it starts")
        if self._moves(1):
            try:
                shapes.load_points(file, duration=self.duration)
            except ValueRangeError:  # it has no orientations: those of the start are needed
                return shapes.load_points(file, start, self.duration)
            self._refuse(1, where, file, "how the hand is turned")
        return shapes.load_points(file, start, self.duration)


class ViaPointsSpec(PointsSpec, frozen=True, kw_only=True, tag="via-points"):
    """Run smoothly through the poses of a file; see `dqcontrol.references.ViaPoints`."""

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        points = self._points(start, folder, where)
        return shapes.ViaPoints(points.times, points.poses)


class SequenceSpec(ReferenceSpec, frozen=True, kw_only=True, tag="sequence"):
    """References one after the other; each starts where the one before it ends, unless it says otherwise."""

    references: Annotated[list[AnyReference], Meta(min_length=1)]

    def _shape(self, start: Array, folder: Path, where: str) -> shapes.Reference:
        parts, hand = [], start
        for i, each in enumerate(self.references):
            if parts and not math.isfinite(parts[-1].duration):
                raise ValueRangeError(
                    f"references[{i - 1}]: never ends, so nothing can follow it: give its duration"
                )
            parts.append(each.build(hand, folder, f"{where}.references[{i}]"))
            if math.isfinite(parts[-1].duration):
                hand = parts[-1].samples([parts[-1].duration])[0, :8]
        return shapes.Sequence(parts)


AnyReference = (
    SetPointSpec
    | DriveToSpec
    | CircleSpec
    | SpiralSpec
    | SquareSpec
    | DrawingSpec
    | PointsSpec
    | ViaPointsSpec
    | SequenceSpec
)
