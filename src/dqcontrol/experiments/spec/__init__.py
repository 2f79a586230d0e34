"""What an experiment's YAML says."""

from dqcontrol.experiments.spec.spec import (
    AnyLaw,
    AnyPlant,
    MetricsFrom,
    RobotSpec,
    Spec,
    StartedRobotSpec,
    as_spec,
    read_data,
    read_spec,
    spec_text,
)

__all__ = [
    "AnyLaw",
    "AnyPlant",
    "MetricsFrom",
    "RobotSpec",
    "Spec",
    "StartedRobotSpec",
    "as_spec",
    "read_data",
    "read_spec",
    "spec_text",
]
