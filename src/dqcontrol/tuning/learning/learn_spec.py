"""The block ``learn`` of a spec, typed, bounded and described."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from dqcontrol.errors import FileFormatError
from dqcontrol.experiments.spec import AnyPlant, as_spec, read_data
from dqcontrol.experiments.spec.key_types import kinds_of, numbers_for_quantities
from dqcontrol.experiments.spec.reference_spec import Part
from dqcontrol.experiments.spec.spec_files import complete_plants, locate_files
from dqcontrol.files.yaml_file import convert
from dqcontrol.tuning.tune_spec import Robustness, SpecWithBlock, identified_file


class Tracker(Part, frozen=True, kw_only=True):
    """What measures the pose of the end effector from outside.

    Parameters
    ----------
    position_noise, orientation_noise
        Standard deviations of each coordinate of a sample, white, m and rad, where it is simulated.
    topic
        Of its poses of the hand in the robot's base frame, ``geometry_msgs/PoseStamped``, for a robot over ROS 2.
    """

    position_noise: Annotated[float, Meta(ge=0, description="m")] = 0.0
    orientation_noise: Annotated[float, Meta(ge=0, description="rad")] = 0.0
    topic: Annotated[str, Meta(min_length=1)] = "/hand_tracker/pose"


class LearnBlock(Part, frozen=True, kw_only=True):
    """Learning from repetition.

    Parameters
    ----------
    repeats
        Most repeats after the first run.
    measured_by
        ``"encoders"``: the end effector's pose follows from the measured joints; ``"tracker"``: it is measured itself.
    tracker
        Its noise.
    sensor_delay
        By how much what is measured is late, s, as of encoders behind a filter.
    cutoff
        Up to which frequency is learnt, Hz; default: as far as the model is sure, 8 Hz at most.
    caution
        ρ: larger values learn slower and take in less noise.
    model
        What the plant is taken for; default: the plant itself, without its noise and what is not linear.
    uncertainty
        What is not known of the model, for which learning must converge as well; ``true``: 20 % of the lag and a
        period, or the intervals of an identified plant; default: that of identified plants and models only.
    skip
        Start of each repeat from which nothing is learnt, s, twice as long until all counts: for motions that begin
        with a jump.
    return_time
        In which the end effector goes back where a motion ends elsewhere than it starts, s.
    """

    repeats: Annotated[int, Meta(ge=1, le=1000)] = 5
    measured_by: Literal["encoders", "tracker"] = "encoders"
    tracker: Tracker = Tracker()
    sensor_delay: Annotated[float, Meta(ge=0, le=1, description="s")] = 0.0
    cutoff: Annotated[float, Meta(gt=0, description="Hz")] | None = None
    caution: Annotated[float, Meta(gt=0, le=1000)] = 0.4
    model: AnyPlant | None = None
    uncertainty: Robustness | bool | None = None
    skip: Annotated[float, Meta(ge=0, description="s")] = 0.0
    return_time: Annotated[float, Meta(gt=0, description="s")] | None = None


class _WithLearn(msgspec.Struct):
    learn: LearnBlock = LearnBlock()


class LearnProblem(SpecWithBlock[LearnBlock]):
    """A spec with its block ``learn``."""

    def points(self, file: str | Path) -> dict[str, Any]:
        """Return the reference of a spec that runs a motion from a file, with the preview that this spec has."""
        preview = self.spec.reference.preview
        more = {} if preview is None else {"preview": msgspec.to_builtins(preview)}
        return {"kind": "points", "file": str(file), **more}


def read_learn(source: str | Path | dict[str, Any], **changes: Any) -> LearnProblem:
    """Return what a spec with the key ``learn`` asks for; without it, learning with all defaults.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary.
    **changes
        Keys of the block that differ; None for none.

    Raises
    ------
    Error
        If it is missing or malformed, or describes several runs.
    """
    where, data, folder = read_data(source)
    plain = dict(data)
    given = {key: value for key, value in changes.items() if value is not None}
    block_data = {**(plain.pop("learn", None) or {}), **given}
    plain.pop("tune", None)
    locate_files(plain, folder)
    identified = identified_file({"plant": block_data.get("model")}, folder) or identified_file(plain, folder)
    if isinstance(block_data.get("model"), dict):
        of_model = {"plant": dict(block_data["model"])}
        complete_plants(of_model, folder)
        block_data["model"] = of_model["plant"]
    whole = numbers_for_quantities(where, {"learn": block_data}, list(kinds_of(_WithLearn)))
    block = convert(where, whole, _WithLearn).learn
    spec = as_spec(where, plain, folder)
    if not spec.is_single:
        raise FileFormatError(f"{where}: describes several runs ({spec.several}); learning takes one")
    return LearnProblem(where, plain, folder, spec, block, identified)
