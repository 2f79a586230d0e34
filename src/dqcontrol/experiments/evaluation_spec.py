"""What ``spec.yaml`` says of an evaluated log, and its run read back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from dqcontrol.experiments.run import Run
from dqcontrol.experiments.spec import RobotSpec
from dqcontrol.experiments.spec.reference_base import Part
from dqcontrol.experiments.spec.spec_files import use_copies
from dqcontrol.files.text_file import read_text
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.loop import Record


class EvaluationSpec(Part, frozen=True, kw_only=True):
    """What was evaluated, as ``spec.yaml`` of its results holds it; see `dqcontrol.logs.evaluate_log`."""

    log: str
    robot: RobotSpec
    reference: str | None = None
    reference_topic: str | None = None
    joints: list[str] | None = None
    joint_topic: str | None = None
    command_topic: str | None = None
    angles: Literal["rad", "deg"] | None = None
    reference_joints: str | list[str] | None = None
    missing: Literal["interpolate", "skip"] = "interpolate"
    align: bool = False
    start: Annotated[float, Meta(description="s")] = 0.0
    duration: Annotated[float, Meta(gt=0, description="s")] | None = None
    skip_initial: Annotated[float, Meta(ge=0, description="s")] = 0.0
    low_pass: Annotated[float, Meta(gt=0, description="Hz")] | None = None


class _SavedEvaluation(Part, frozen=True, kw_only=True):
    evaluation: EvaluationSpec


def saved_evaluation(spec: Path, record: Record) -> Run:
    """Return what `Run.save` has written of an evaluation: the content of ``spec.yaml`` and its record.

    Raises
    ------
    FileFormatError
        If the file is none of an evaluation.
    """
    text = read_text(spec)
    data = parse_yaml(spec, text)
    use_copies(data, spec.parent)
    what = convert(spec, data, _SavedEvaluation).evaluation
    robot = what.robot.load()
    return Run(text, robot, record, what.skip_initial, Path(what.log).stem, low_pass=what.low_pass)
