"""The driver of LeRobot's arms in LeRobot's own hands; its robot is the plug's, in physics."""

import json

import numpy as np
import pytest
import yaml

pytestmark = pytest.mark.slow

START = [0, -0.8, 0, -2.2, 0, 1.6, 0.8]
SPEC = {
    "name": "follow", "robot": "panda", "start": START, "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.03, "duration": 3.0},
    "law": {"kind": "proportional-feedforward", "gain": 3},
    "supervisor": {"stale_after": 1.0, "frozen_after": 1.0},
}  # fmt: skip
DRIVEN = """
import json, sys
from dqcontrol.experiments import run_in_real_time
done = run_in_real_time(sys.argv[1], "results", figures=False)
print("\\n" + json.dumps({"stopped": done.record.stopped, "q": done.record.q.tolist(),
                         "error": done.record.position_error.max()}))
"""


def test_an_arm_of_lerobot_runs_a_spec(lerobot, tmp_path):
    simulated = {**SPEC, "plant": {"kind": "mujoco"}}
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(simulated))
    arm = {"type": "dqcontrol", "id": "driven", "spec": "arm.yaml"}
    plant = {"kind": "lerobot", "robot": arm, "units": "rad", "timeout": 1.0}
    (tmp_path / "driven.yaml").write_text(yaml.safe_dump({**SPEC, "plant": plant}))
    said = json.loads(lerobot("-c", DRIVEN, "driven.yaml").splitlines()[-1])
    assert said["stopped"] == "duration"
    assert np.ptp(said["q"], axis=0).max() > 0.02
    assert said["error"] < 0.03
