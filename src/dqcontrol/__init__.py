"""Dual quaternion control laws for arms: compiled simulation, physics, experiments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dqcontrol.moved import find_moved, register

if TYPE_CHECKING:
    from dqcontrol import (
        algebra,
        browser,
        errors,
        experiments,
        export,
        figures,
        films,
        geometry,
        laws,
        limits,
        logs,
        loop,
        measures,
        plants,
        recording,
        references,
        reports,
        reproductions,
        robots,
        tuning,
    )
    from dqcontrol.algebra import DualQuaternion
    from dqcontrol.errors import Error
    from dqcontrol.experiments import Run, Study, run_study

    # From its module, and `simulate` too: type checkers take a package's `run` for the module of that name.
    from dqcontrol.experiments.run import run
    from dqcontrol.logs.calibration.kinematic_calibration import calibrate
    from dqcontrol.logs.servos.excitation import excite
    from dqcontrol.logs.servos.identification import identify
    from dqcontrol.loop import Record
    from dqcontrol.loop.simulate import simulate
    from dqcontrol.references import Sample
    from dqcontrol.robots import (
        CarLikeBase,
        Chassis,
        DifferentialDrive,
        HolonomicBase,
        Inertia,
        Kinematics,
        Limits,
        MecanumBase,
        OmniBase,
        Robot,
        SerialArm,
        Solution,
        SteeredTricycle,
        TreeRobot,
        TwoArms,
        WholeBody,
        load_mobile,
        load_robot,
        load_tree,
        robot_names,
    )
    from dqcontrol.tuning import Learning, Tuning, learn, tune

__version__ = "0.1.0"

__all__ = [
    "CarLikeBase",
    "Chassis",
    "DifferentialDrive",
    "DualQuaternion",
    "Error",
    "HolonomicBase",
    "Inertia",
    "Kinematics",
    "Learning",
    "Limits",
    "MecanumBase",
    "OmniBase",
    "Record",
    "Robot",
    "Run",
    "Sample",
    "SerialArm",
    "Solution",
    "SteeredTricycle",
    "Study",
    "TreeRobot",
    "Tuning",
    "TwoArms",
    "WholeBody",
    "algebra",
    "browser",
    "calibrate",
    "errors",
    "excite",
    "experiments",
    "export",
    "figures",
    "films",
    "geometry",
    "identify",
    "laws",
    "learn",
    "limits",
    "load_mobile",
    "load_robot",
    "load_tree",
    "logs",
    "loop",
    "measures",
    "plants",
    "recording",
    "references",
    "reports",
    "reproductions",
    "robot_names",
    "robots",
    "run",
    "run_study",
    "simulate",
    "tune",
    "tuning",
]

_ROOMS = (
    "algebra",
    "browser",
    "errors",
    "experiments",
    "export",
    "figures",
    "films",
    "geometry",
    "laws",
    "limits",
    "logs",
    "loop",
    "measures",
    "plants",
    "recording",
    "references",
    "reports",
    "reproductions",
    "robots",
    "tuning",
)
_HOMES = {
    "DualQuaternion": "algebra",
    "Error": "errors",
    "Record": "loop",
    "Run": "experiments",
    "Sample": "references",
    "Study": "experiments",
    "calibrate": "logs",
    "excite": "logs",
    "identify": "logs",
    "run": "experiments",
    "run_study": "experiments",
    "simulate": "loop",
    "Learning": "tuning",
    "learn": "tuning",
    "tune": "tuning",
    "Tuning": "tuning",
}  # of all others: robots


def __getattr__(name: str) -> Any:
    """Import what is first asked for, so that neither the package nor the command line waits for the rest."""
    import importlib

    if name in _ROOMS:
        return importlib.import_module(f"dqcontrol.{name}")
    if name in __all__:
        found = getattr(importlib.import_module(f"dqcontrol.{_HOMES.get(name, 'robots')}"), name)
        globals()[name] = found
        return found
    return find_moved(__name__, name)


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])


register()
