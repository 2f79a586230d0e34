"""Dual quaternion control laws for arms: compiled simulation, physics, experiments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dqcontrol import algebra
from dqcontrol.algebra import DualQuaternion
from dqcontrol.errors import Error
from dqcontrol.robots import (
    DifferentialDrive,
    HolonomicBase,
    Inertia,
    Kinematics,
    Limits,
    Robot,
    SerialArm,
    Solution,
    WholeBody,
    load_robot,
    robot_names,
)

if TYPE_CHECKING:
    from dqcontrol import experiments, laws, limits, loop, plants, references
    from dqcontrol.experiments import Run, Study, run, run_study
    from dqcontrol.loop import simulate
    from dqcontrol.references import Sample

__version__ = "0.1.0"

__all__ = [
    "DifferentialDrive",
    "DualQuaternion",
    "Error",
    "HolonomicBase",
    "Inertia",
    "Kinematics",
    "Limits",
    "Robot",
    "Run",
    "Sample",
    "SerialArm",
    "Solution",
    "Study",
    "WholeBody",
    "algebra",
    "experiments",
    "laws",
    "limits",
    "load_robot",
    "loop",
    "plants",
    "references",
    "robot_names",
    "run",
    "run_study",
    "simulate",
]

_ROOMS = ("experiments", "laws", "limits", "loop", "plants", "references", "view")
_LATER = {
    "Run": "experiments",
    "Sample": "references",
    "Study": "experiments",
    "run": "experiments",
    "run_study": "experiments",
    "simulate": "loop",
}


def __getattr__(name: str) -> Any:
    """Import a room when it is first asked for, so that the package itself imports fast."""
    import importlib

    if name in _ROOMS:
        return importlib.import_module(f"dqcontrol.{name}")
    if name in _LATER:
        return getattr(importlib.import_module(f"dqcontrol.{_LATER[name]}"), name)
    raise AttributeError(f"module 'dqcontrol' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS})
