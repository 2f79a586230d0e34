"""Constraints around laws; programs with constraints, and levels of rows that give way."""

from dqcontrol.laws.constrained.constraints import (
    Angle,
    BoxObstacle,
    BoxZone,
    CapsuleObstacle,
    Constraints,
    CylinderObstacle,
    CylinderZone,
    LineOfSight,
    MapObstacle,
    PlaneObstacle,
    PlaneZone,
    SphereObstacle,
    SphereZone,
)
from dqcontrol.laws.constrained.programs import (
    LevelSolution,
    ProgramSolution,
    lexicographic_program,
    quadratic_program,
)

__all__ = [
    "Angle",
    "BoxObstacle",
    "BoxZone",
    "CapsuleObstacle",
    "Constraints",
    "CylinderObstacle",
    "CylinderZone",
    "LevelSolution",
    "LineOfSight",
    "MapObstacle",
    "PlaneObstacle",
    "PlaneZone",
    "ProgramSolution",
    "SphereObstacle",
    "SphereZone",
    "lexicographic_program",
    "quadratic_program",
]
