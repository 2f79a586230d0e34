"""What was identified of servos, in physics: what fits is taken, what does not is said."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import NoteWarning
from dqcontrol.experiments.spec import read_spec

pytest.importorskip("mujoco")

LAGS = [0.05, 0.04, 0.06, 0.05, 0.03, 0.04, 0.05]
FILE = f"""
plant: {{kind: servo, time_constant: {LAGS}, bandwidth: [0, 0, 30.0, 0, 0, 0, 0], damping_ratio: 0.8,
  delay: 0.012, encoder_noise: [1.0e-4, 0, 0, 0, 0, 0, 2.0e-4], friction: 2.0e-4}}
"""
SPEC = {
    "name": "twin",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1},
    "law": {"kind": "proportional", "gain": 3},
}


@pytest.fixture
def file(tmp_path):
    (tmp_path / "plant.yaml").write_text(FILE, encoding="utf-8")
    return str(tmp_path / "plant.yaml")


def test_servos_in_physics_are_as_quick_as_those_identified(file):
    with pytest.warns(
        NoteWarning, match=r"no place for a delay of 0\.012 s, play of ± 0\.0002 rad: left out"
    ):
        plant = read_spec(SPEC | {"plant": {"kind": "mujoco", "file": file, "encoder_noise": 0.0}})[0].plant
    assert plant.encoder_noise == 0.0  # what the spec says itself counts
    assert np.allclose(
        plant.bandwidth, [30 / (2 * math.pi) if i == 2 else 1 / (math.pi * lag) for i, lag in enumerate(LAGS)]
    )
    assert plant.damping_ratio == [1, 1, 0.8, 1, 1, 1, 1]
    # A constant command: each joint follows later than its target by what its servo is late for slow motions.
    arm = dqc.load_robot("iiwa7")
    live = plant.start(arm, np.array(SPEC["start"]), 0.01, 200, 0)
    for _ in range(150):
        live.step(np.full(7, 0.02))
    late = (np.array(SPEC["start"]) + 150 * 0.01 * 0.02 - live.q) / 0.02
    expected = [2 * 0.8 / 30 if i == 2 else lag for i, lag in enumerate(LAGS)]
    np.testing.assert_allclose(late, expected, rtol=0.1)


def test_a_compliant_arm_takes_encoders_and_says_that_it_has_lags_of_its_own(file):
    spec = SPEC | {"robot": "meka-a2", "plant": {"kind": "compliant", "file": file}}
    with pytest.warns(
        NoteWarning, match=r"a compliant arm has no place for lags of 0\.03 to 0\.05\d* s, a delay"
    ):
        plant = read_spec(spec)[0].plant
    assert plant.encoder_noise == 2e-4
    assert plant.encoder_resolution == 0
