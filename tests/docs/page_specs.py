"""The YAML on a page: robots' files, and parts of experiments, which go on from part to part."""

from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.experiments.spec import as_spec
from dqcontrol.experiments.sweep import read_sweep
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.robots import load_robot
from dqcontrol.tuning.spec_blocks import read_learn, read_tune

START = [0, 0.6, 0, 1.6, 0, 0.6, 0]


class PageSpec:
    """An experiment whose keys the blocks of a page replace; each must leave a good one."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.data: dict[str, Any] = {
            "name": "page",
            "robot": "iiwa7",
            "start": START,
            "period": 0.01,
            "reference": {"kind": "circle", "radius": 0.05, "duration": 1},
            "laws": {"K": {"kind": "proportional", "gain": 5}},
            "plant": {"kind": "servo", "time_constant": 0.05},
        }

    def take(self, text: str) -> None:
        """Take in a block; raise if it means nothing."""
        part = parse_yaml("page", text)
        if {"joints", "parts", "left"} & part.keys():
            path = self.folder / "robot.yaml"
            path.write_text(text, encoding="utf-8")
            assert load_robot(path).configuration_size > 0
            return
        for both in ({"law", "laws"}, {"plant", "plants"}, {"parameter_sets", "grids"}):
            if both & part.keys():
                self.data = {key: value for key, value in self.data.items() if key not in both}
        if "world" in part and "world" in self.data:
            part["world"] = self.data["world"] | part["world"]
        self.data |= part
        if "sweep" in self.data:
            assert read_sweep(self.data).sampling.over
            del self.data["sweep"]
        if "tune" in self.data:
            assert read_tune(self.data).block.objectives
            del self.data["tune"]
        if "learn" in self.data:
            assert read_learn(self.data).block.repeats
            del self.data["learn"]
        spec = as_spec("page", self.data, self.folder / "examples")
        motion = spec.reference.build(load_robot("iiwa7").fkm(START), self.folder / "examples")
        assert np.isfinite(motion.samples(np.linspace(0, min(motion.duration, 100), 20))).all()
