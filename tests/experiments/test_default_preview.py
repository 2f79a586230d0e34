"""A spec is the same controller wherever it runs: its twists lead its joints' lag by the same, or not at all."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.export.controller_parts import controller_parts
from dqcontrol.references import Previewed
from dqcontrol.references.sample import TWIST
from dqcontrol.ros2.loading import load
from dqcontrol.tuning.law_search import ready_problem
from dqcontrol.tuning.spec_blocks import read_tune

LAG, DELAY, PERIOD = 0.05, 0.02, 0.01
SPEC = {
    "name": "led",
    "robot": "iiwa7",
    "start": [0.0, 0.6, 0.0, 1.6, 0.0, 0.6, 0.0],
    "period": PERIOD,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1.0, "ramp": 0.2},
    "law": {"kind": "proportional-feedforward", "gain": 5},
    "plant": {"kind": "servo", "time_constant": LAG, "delay": DELAY},
}
PRINTED = {"kind": "proportional-feedforward", "feedforward": "printed", "gain": 5}


def led(reference):
    """Return delay, lag and step of a preview; nothing of others."""
    return (reference.delay, reference.lag, reference.step) if isinstance(reference, Previewed) else ()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, (DELAY + PERIOD / 2, LAG, PERIOD)),
        ({"reference": SPEC["reference"] | {"preview": {"lag": 0.1}}}, (0.0, 0.1, None)),
        ({"reference": SPEC["reference"] | {"preview": {}}}, (0.0, 0.0, None)),
        ({"law": PRINTED}, ()),
        ({"law": {"kind": "proportional", "gain": 5}}, ()),
        ({"plant": {"kind": "integrator"}}, ()),
    ],
    ids=["default", "its own", "none", "printed", "no feed-forward", "no lag"],
)
def test_run_export_ros_and_tune_follow_the_same(tmp_path, changes, expected):
    data = SPEC | changes
    setting = prepare(data)
    (case,) = setting.cases
    assert led(case.scene.reference) == pytest.approx(expected)
    ready = case.prepare_law(setting.spec)
    record = dqc.run(data).record
    samples = case.scene.samples
    assert np.array_equal(record.desired, samples)

    parts = controller_parts(data)
    assert np.array_equal(parts.samples, samples)
    assert np.array_equal(parts.law.parameters, ready.parameters)

    (tmp_path / "spec.yaml").write_text(prepare(data).text, encoding="utf-8")
    loaded = load(tmp_path / "spec.yaml")
    assert np.array_equal(loaded.case.scene.samples, samples)
    assert np.array_equal(loaded.prepared_law("spec").parameters, ready.parameters)

    problem = ready_problem(read_tune(data | {"tune": {"budget": 1}}))
    (scene,), ((loop,),) = problem.searched._as_followed(case.variant.law)
    assert np.array_equal(scene.samples, samples)
    seen = loop.run(*problem.searched.prepared(case.variant.law))
    assert np.array_equal(seen.q, record.q)
    assert np.array_equal(seen.command, record.command)


def test_laws_of_one_spec_are_led_each_as_it_asks():
    data = {key: value for key, value in SPEC.items() if key != "law"}
    laws = {"K": {"kind": "proportional", "gain": 5}, "printed": PRINTED, "second order": SPEC["law"]}
    setting = prepare(data | {"laws": laws})
    plain, printed, second = setting.cases
    assert plain.scene is printed.scene is setting.scene
    assert second.scene is not setting.scene
    assert np.abs(second.scene.samples[:, TWIST] - setting.scene.samples[:, TWIST]).max() > 0.01
