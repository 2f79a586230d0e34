"""What an experiment's YAML says."""

from dqcontrol.experiments.spec.spec import (
    AnyLaw,
    AnyPlant,
    HandStart,
    Judged,
    RobotSpec,
    Spec,
    StartedRobotSpec,
    as_spec,
    quantities_at,
    read_data,
    read_spec,
    spec_text,
)

__all__ = [
    "AnyLaw",
    "AnyPlant",
    "HandStart",
    "Judged",
    "RobotSpec",
    "Spec",
    "StartedRobotSpec",
    "as_spec",
    "quantities_at",
    "read_data",
    "read_spec",
    "spec_text",
]
