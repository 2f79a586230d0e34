"""Learning of forces: the deflection answers as its model says, and after one repeat the force is what is wanted."""

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.loop.simulate import simulate_prepared
from dqcontrol.plants.servo import Servo
from dqcontrol.references import SetPoint
from dqcontrol.references.sample import POSE
from dqcontrol.tuning.learning_convergence import Convergence, ForceShape, loop_shape
from dqcontrol.tuning.learnt_motion import ForceLearning, motion_of

EXAMPLES = Path(__file__).parents[2] / "examples"
START = [0, 0.6, 0, -1.6, 0, 0.9, 0]
SPEC = {
    "name": "press",
    "robot": "iiwa7",
    "start": START,
    "period": 0.004,
    "reference": {"kind": "circle", "plane": "xy", "radius": 0.03, "duration": 4, "ramp": 1.0},
    "law": {"kind": "proportional-feedforward", "gain": 1},
    "contact": {
        "axes": "base",
        "translation": {"damping": 150, "stiffness": ["rigid", "rigid", 0]},
        "force": {"z": 2},
        "sensor": {"filter": 0.005},
    },
    "world": {
        "board": {
            "box": [0.4, 0.4, 0.04],
            "position": [0.55, 0, 0.284],
            "rpy": [0.05, 0, 0],
            "stiffness": 2000,
            "friction": 0.2,
        }
    },
    "plant": {
        "kind": "servo",
        "time_constant": 0.05,
        "delay": 0.02,
        "wrist": {"filter": 0.005, "force_noise": 0.1},
    },
}


def spec(**changes):
    return copy.deepcopy(SPEC) | changes


def sd_of_force(record, begin):
    return record.readings["touch_force"].values[record.time >= begin, 2].std()


def test_after_one_repeat_the_force_is_within_a_tenth_of_a_newton():
    """The figure of issue and page: 2 N at 50 mm/s on 2 kN/m behind 50 + 20 ms, at most 0.1 N after one repeat."""
    found = dqc.learn(EXAMPLES / "learn-force.yaml")
    first, best = found.repeats[0], found.repeats[found.best]
    assert found.best == 1
    assert first.force > 0.25
    assert best.force < 0.05
    assert sd_of_force(found.last, 2.0) < 0.05 < 0.25 < sd_of_force(found.first, 2.0)
    assert best.position < 0.1 * first.position  # the plan's axes learn beside it
    assert found.gain == first.force / best.force
    assert "touch" not in found.stopped
    assert all(each.force < 0.05 for each in found.repeats[1:])  # nothing comes back


@pytest.mark.parametrize("axes", ["base", "reference", "hand"])
def test_what_was_learnt_runs_in_the_same_loop_along_whichever_axes(tmp_path, axes):
    """The end effector points down: along its axes the board is felt with the other sign."""
    contact = SPEC["contact"] | {"axes": axes}
    if axes != "base":
        arm = dqc.load_robot("iiwa7")
        turn = dqc.algebra.matrix_from_pose(arm.fkm(np.array(START)))[:3, :3]
        contact["force"] = {"z": 2 * float(np.sign(turn[2, 2]))}
        assert abs(turn[2, 2]) > 0.99
    found = dqc.learn(spec(contact=contact), repeats=1)
    assert found.repeats[1].force < 0.2 * found.repeats[0].force
    assert found.repeats[1].force < 0.06
    found.save(tmp_path / "out")
    run = dqc.run(tmp_path / "out" / "learnt.yaml")
    assert sd_of_force(run.record, 2.0) < 0.06


def test_a_shift_makes_the_frame_give_way_as_the_model_says():
    """By simulation: a board that is always touched, and shifts of sines."""
    setting = prepare(
        spec(reference={"kind": "set-point"}, duration=8, plant=SPEC["plant"] | {"wrist": {"filter": 0.005}})
    )
    (case,) = setting.cases
    contact, law, scene = case.variant.law.contact, case.prepare_law(setting.spec), setting.scene
    shape = loop_shape(scene.robot, law, case.gains, scene.start, SetPoint(scene.samples[0, POSE]))
    model = Servo(time_constant=0.05, delay=0.02).linear_model(scene.robot, scene.start, 0.004)
    flat = replace_board(case.plant, rpy=(0, 0, 0), friction=0.0)
    for frequency in (0.5, 2.0):
        shift = np.zeros((len(scene.samples), 6))
        time = scene.samples[:, 20]
        shift[:, 5] = 5e-4 * np.sin(2 * np.pi * frequency * time)
        samples = motion_of(scene.samples, shift).samples(time)
        record = simulate_prepared(law, flat, scene.start, samples)
        forced = ForceShape(shape.gain, shape.feedforward, 0.004, damping=150, filter=0.005, stiffness=2000)
        learning = ForceLearning(contact, scene.robot, {5: Convergence(forced, (model,), 0.4, 8.0)})
        seen = learning.pressed(record).deflection[:, 5]
        late = time > 4.0  # whole periods of each
        wave = np.exp(-2j * np.pi * frequency * time[late])
        answer = -2 * np.mean((seen[late] - seen[late].mean()) * wave) * 1j / 5e-4
        expected = forced.response(model, np.array([frequency]))[0, 0, 0]
        assert abs(answer - expected) < 0.03 * abs(expected)


def replace_board(plant, **changes):
    from msgspec.structs import replace as changed

    board = changed(plant.world.bodies["board"], **changes)
    return plant.in_world(dqc.World(bodies={"board": board}))


def test_the_deflection_is_found_again_from_the_record():
    """In contact the frame lies where the end effector is, up to its lag; it touches when the true force does."""
    setting = prepare(spec())
    (case,) = setting.cases
    scene, law = setting.scene, case.prepare_law(setting.spec)
    record = simulate_prepared(law, case.plant, scene.start, scene.samples, seed=3)
    shape = loop_shape(scene.robot, law, case.gains, scene.start, scene.reference)
    seen = ForceLearning(
        case.variant.law.contact, scene.robot, {5: Convergence(shape, (), 0.4, 8.0)}
    ).pressed(record)
    depth = record.position[:, 2] - record.desired_position[:, 2]
    assert np.abs(seen.deflection[:, 5] - depth)[record.time > 1.0].max() < 3e-4
    pressed = record.time[record.readings["touch_force"].values[:, 2] > 1.0][0]
    assert 0 <= seen.first_touch - pressed < 0.03
    true = record.readings["touch_force"].values[:, 2] - 2.0
    assert abs((seen.error[:, 0] - true)[record.time > 1.0].mean()) < 0.01


@pytest.mark.slow
def test_gaps_of_a_hard_board_close():
    """20 kN/m, on which force control alone jumps: 2 N come back from repeat to repeat."""
    source = yaml.safe_load((EXAMPLES / "learn-force.yaml").read_text())
    pause, script = source["reference"]["references"]
    pause["duration"], script["file"] = 8.0, str(EXAMPLES / script["file"])
    source["world"]["board"]["stiffness"] = 20_000
    source["contact"]["translation"]["damping"] = 1300
    source["plant"] |= {"time_constant": 0.03, "delay": 0.01}
    found = dqc.learn(source, repeats=3)
    assert found.repeats[0].force > 1.5
    assert found.repeats[found.best].force < 0.06


def test_a_stiffness_that_is_not_known_narrows_the_band():
    """With twice the stiffness the deflection would grow from about 3 Hz on: said before, and the band ends below."""
    sure, unsure = (dqc.learn(spec(learn={"uncertainty": each}), repeats=1) for each in (False, True))
    assert sure.convergence.cutoff == 8.0
    assert unsure.convergence.cutoff < 3.5
    assert unsure.repeats[1].force < 0.35 * unsure.repeats[0].force
    with pytest.raises(Error, match=r"learn\.cutoff: with 8 Hz errors grow from"):
        dqc.learn(spec(learn={"uncertainty": True, "cutoff": 8}), repeats=1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"reference": SPEC["reference"] | {"touch": {"force": 1}}}, "'until' and 'touch' end when"),
        (
            {"world": {"board": SPEC["world"]["board"] | {"position": [0.55, 0, 0.1]}}},
            "the first run touched nothing of 4.5 s",
        ),
    ],
)
def test_a_mistake_is_one_clear_line(changes, words):
    with pytest.raises(Error, match=words):
        dqc.learn(spec(**changes), repeats=1)


def test_a_robot_whose_records_have_no_wrench_is_refused():
    def blind(problem, motion, number):
        setting = prepare(problem.data)
        (case,) = setting.cases
        record = simulate_prepared(
            case.prepare_law(setting.spec), case.plant, case.scene.start, case.scene.samples
        )
        return replace(record, readings={})

    with pytest.raises(Error, match="has no readings wrist_force and wrist_torque"):
        dqc.learn(spec(), repeats=1, runner=blind)
