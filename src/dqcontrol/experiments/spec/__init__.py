"""What an experiment's YAML says."""

from dqcontrol.experiments.spec.spec import (
    AnyLaw,
    AnyPlant,
    HandStart,
    MetricsFrom,
    RobotSpec,
    Spec,
    Start,
    StartedRobotSpec,
    as_spec,
    quantities_at,
    read_data,
    read_spec,
    spec_text,
    start_configuration,
)

__all__ = [
    "AnyLaw",
    "AnyPlant",
    "HandStart",
    "MetricsFrom",
    "RobotSpec",
    "Spec",
    "Start",
    "StartedRobotSpec",
    "as_spec",
    "quantities_at",
    "read_data",
    "read_spec",
    "spec_text",
    "start_configuration",
]
