"""Learning from repetition: errors shrink as the model says, the motion runs elsewhere, mistakes are said before."""

import copy
import json
import time
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol.errors import Error, NoteWarning
from dqcontrol.experiments import check
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.loop.signals import Signal
from dqcontrol.loop.simulate import simulate_prepared
from dqcontrol.references.points import DUAL_QUATERNION
from dqcontrol.tuning import Convergence, learn_to
from dqcontrol.tuning.learning_convergence import LoopShape, loop_shape
from dqcontrol.tuning.learnt_motion import TRACKED_POSE, hand_error, motion_of, shifted_poses
from dqcontrol.tuning.run_learning import _outcome

START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
SPEC = {
    "name": "again",
    "robot": "iiwa7",
    "start": START.tolist(),
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 2.5, "ramp": 0.5},
    "law": {"kind": "proportional", "gain": 5},
    "plant": {"kind": "servo", "time_constant": 0.05, "delay": 0.02, "sag": 1},
}

SERVO = dqc.plants.Servo(time_constant=0.05, delay=0.02)


def spec(kind="proportional", **changes):
    return copy.deepcopy(SPEC) | {"law": {"kind": kind, "gain": 5}} | changes


def noisy(kind, noise=5e-4):
    return spec(kind, plant=SPEC["plant"] | {"encoder_noise": noise})


@pytest.mark.parametrize(("kind", "factor"), [("proportional", 30), ("proportional-feedforward", 10)])
def test_errors_shrink_and_never_come_back(kind, factor):
    found = dqc.learn(noisy(kind), repeats=4)
    assert found.gain > factor
    first, best = found.repeats[0], found.repeats[found.best]
    assert (best.outcome, found.stopped) == ("averaged", "what is left is the sensors' noise")
    assert found.best == 4
    assert best.position < first.position / factor
    again = dqc.run(found.problem.data | {"seed": 99})  # the same loop unlearnt: nothing else has changed
    assert again.metrics.position.rms == pytest.approx(first.position, rel=0.05)


def test_a_delay_of_half_a_period_more_is_learnt_as_well():
    """A learnt motion is points, and their twists were read half a period early."""
    stops = {"kind": "circle", "radius": 0.05, "duration": 2.5, "corner_stops": 0.5}
    late = {"kind": "servo", "time_constant": 0.05, "delay": 0.025}
    found = dqc.learn(spec("proportional-feedforward", reference=stops, plant=late), repeats=2)
    assert found.gain > 100


def test_without_noise_it_goes_below_a_hundredth_of_a_millimetre():
    found = dqc.learn(spec("proportional-feedforward"), repeats=4)
    assert found.repeats[-1].position < 0.01
    assert found.repeats[-1].orientation < 0.01
    assert [each.outcome for each in found.repeats] == ["first", *["accepted"] * (len(found.repeats) - 1)]


@pytest.mark.slow
@pytest.mark.parametrize("preview", [None, {"delay": 0.01, "lag": 0.03}])
@pytest.mark.parametrize("kind", ["proportional", "proportional-feedforward"])
def test_the_learnt_motion_runs_elsewhere_with_the_same_error(tmp_path, kind, preview):
    """With the preview of the spec, or that which its plant asks for."""
    reference = SPEC["reference"] | ({} if preview is None else {"preview": preview})
    found = learn_to(spec(kind, reference=reference), tmp_path / "out", repeats=2)
    for name in ("learnt.csv", "learnt.yaml", "learning.json", "learning.svg", "report.html", "learning.md"):
        assert (tmp_path / "out" / name).is_file(), name
    run = dqc.run(tmp_path / "out" / "learnt.yaml")
    assert np.abs(run.q - found.last.q).max() < 1e-12
    errors = hand_error(found.first.desired_pose, run.pose)[:, 3:]
    rms = 1e3 * np.sqrt(np.mean(np.sum(errors**2, axis=1)))
    assert rms == pytest.approx(found.repeats[found.best].position)
    history = json.loads((tmp_path / "out" / "learning.json").read_text())
    assert [each["position"] for each in history["repeats"]] == [each.position for each in found.repeats]


def test_what_was_interrupted_goes_on_with_the_repeats_that_are_left(tmp_path, monkeypatch):
    def stop_after_two(done, total):
        if done == 2:
            raise KeyboardInterrupt

    whole = dqc.learn(noisy("proportional"), repeats=3)
    with pytest.raises(KeyboardInterrupt):
        dqc.learn(noisy("proportional"), repeats=3, journal=tmp_path / "kept", progress=stop_after_two)
    ran = []

    def counted(*given, **options):
        ran.append(options["seed"])
        return simulate_prepared(*given, **options)

    monkeypatch.setattr("dqcontrol.tuning.run_learning.simulate_prepared", counted)
    resumed = dqc.learn(noisy("proportional"), repeats=3, journal=tmp_path / "kept")
    assert ran == list(range(2, len(whole.repeats)))
    assert resumed.repeats == whole.repeats
    assert (resumed.last.pose == whole.last.pose).all()
    with pytest.raises(Error, match=r"^journal: runs on the clock are not resumed; leave it out$"):
        dqc.learn(spec(), journal=tmp_path / "kept", real_time=True)


def test_a_shift_and_its_error_are_opposites():
    rng = np.random.default_rng(3)
    robot = dqc.load_robot("iiwa7")
    poses = robot.fkm(START + 0.2 * rng.standard_normal((30, 7)))
    shift = 0.3 * rng.standard_normal((30, 6))
    assert np.abs(hand_error(shifted_poses(poses, shift), poses) - shift).max() < 1e-12
    samples = np.zeros((30, 21))
    samples[:, :8], samples[:, 20] = poses, 0.01 * np.arange(30)
    moved = motion_of(samples, np.zeros((30, 6))).samples(samples[:, 20])
    assert np.abs(dqc.algebra.translation(moved[:, :8]) - dqc.algebra.translation(poses)).max() < 1e-12


@pytest.mark.parametrize(
    ("kind", "delay"),
    [
        ("proportional", 0.02),
        ("proportional-feedforward", 0.02),
        ("proportional-feedforward", 0.025),
        ("proportional-feedforward", 0.022),
        ("h-infinity-tracking", 0.02),
    ],
)
def test_the_loop_answers_a_shift_as_its_model_says(kind, delay):
    """The hand of a simulated servo arm, shaken by a small sine, beside the linear model's response."""
    gains = {"orientation_gain": 10, "translation_gain": 5} if kind.startswith("h") else {"gain": 5}
    data = spec(kind, law={"kind": kind, **gains}, plant=SPEC["plant"] | {"sag": 0, "delay": delay})
    setting = prepare(data)
    (case,) = setting.cases
    law = case.prepare_law(setting.spec)
    reference = case.scene.reference
    shape = loop_shape(case.scene.robot, law, case.gains, START, reference)
    assert shape.feedforward == (0.0 if kind == "proportional" else 1.0)
    time, amplitude = 0.01 * np.arange(1200), 1e-3
    rest = np.zeros((1200, 21))
    rest[:, :8], rest[:, 20] = case.scene.robot.fkm(START), time
    for frequency in (0.5, 2.0, 5.0):
        shift = np.zeros((1200, 6))
        shift[:, 4] = amplitude * np.sin(2 * np.pi * frequency * time)
        motion = motion_of(rest, shift)
        if isinstance(reference, dqc.references.Previewed):
            motion = dqc.references.Previewed(motion, reference.delay, reference.lag, reference.step)
        samples = motion.samples(time)
        plant = case.plant.start(case.scene.robot, START, 0.01, 1200, 0)
        poses = case.scene.robot.fkm(dqc.loop.close_loop(law, plant, samples).q)
        moved = -hand_error(rest[:, :8], poses)[800:, 4]
        wave = np.exp(-2j * np.pi * frequency * time[800:])
        measured = 2 * np.mean(moved * wave) / (amplitude * -1j)
        model = case.plant.linear_model(case.scene.robot, START, 0.01)
        expected = shape.response(model, np.array([frequency]))[0, 0, 0]
        assert abs(measured - expected) < 0.02 * abs(expected), frequency


def test_what_grows_with_another_plant_is_said_before_and_seen_after():
    """60 ms more delay than the model has: 6 Hz are too many, and what the condition allows converges."""
    late = spec(plant=SPEC["plant"] | {"delay": 0.08})
    model = {"kind": "servo", "time_constant": 0.05, "delay": 0.02}
    with pytest.raises(Error, match=r"errors grow from [123]\.\d Hz on, by .* delays by 60 ms"):
        dqc.learn(late, model=model, cutoff=6, uncertainty={"lag": 0, "delay": 0.06})
    late["reference"] = {"kind": "square", "side": 0.05, "duration": 3, "corner_stops": 0.3}
    unwarned = dqc.learn(late, 8, model=model, cutoff=6, uncertainty=False)
    warned = dqc.learn(late, 8, model=model, uncertainty={"lag": 0, "delay": 0.06})
    assert warned.convergence.cutoff < 4
    assert "grown" not in [each.outcome for each in warned.repeats]
    assert warned.repeats[warned.best].position < 0.6 * unwarned.repeats[unwarned.best].position


def test_the_condition_is_that_of_the_operator():
    robot, setting = dqc.load_robot("iiwa7"), prepare(spec())
    (case,) = setting.cases
    law, reference = case.prepare_law(setting.spec), case.scene.reference
    shape: LoopShape = loop_shape(robot, law, case.gains, START, reference)
    model = SERVO.linear_model(robot, START, 0.01)
    sure = Convergence(shape, (model,), 0.4, 6.0)
    assert sure.breaks_at is None
    assert sure.worst[0] < 1 + 1e-6
    assert 0 < sure.noise_factor < 1
    frequencies, factors = sure.factors()
    expected = 1 - sure.low_pass(frequencies) ** 2 * sure.operator(frequencies) * np.ravel(
        shape.response(model, frequencies)
    )
    assert np.allclose(factors, np.abs(expected))


def test_joints_with_masses_learn_too():
    """MuJoCo, half of gravity compensated: what the joints miss is not in the model."""
    pytest.importorskip("mujoco")
    arm = {"kind": "mujoco", "gravity_compensation": 0.5}
    found = dqc.learn(spec(plant=arm, reference=SPEC["reference"] | {"duration": 2}), repeats=2)
    assert found.gain > 20
    assert [each.outcome for each in found.repeats] == ["first", "accepted", "accepted"]


@pytest.mark.slow
def test_repeats_on_the_clock_are_those_without_it():
    short = spec(reference={"kind": "circle", "radius": 0.01, "duration": 0.4, "ramp": 0.1})
    begun = time.monotonic()
    found = dqc.learn(short, repeats=1, real_time=True)
    assert time.monotonic() - begun > 2 * 0.4
    assert found.repeats == dqc.learn(short, repeats=1).repeats


@pytest.mark.slow
def test_a_tracker_sees_what_encoders_hide():
    pytest.importorskip("mujoco")
    data = spec("proportional-feedforward", robot="meka-a2", period=0.008, plant={"kind": "compliant"})
    data["start"] = [0, 0.6283185, 0, 1.5707963, 0, 0.6283185, 0]
    data["reference"] = {"kind": "circle", "radius": 0.03, "duration": 2.8, "ramp": 0.5, "plane": "xy"}
    data["law"]["gain"] = 3
    seen = dqc.learn(data, repeats=3, measured_by="tracker")
    hidden = dqc.learn(data, repeats=3)
    assert seen.repeats[-1].position < seen.repeats[0].position / 5
    assert seen.repeats[-1].position < 0.8 * hidden.repeats[-1].position
    assert any("encoders: they see" in line for line in hidden.notes)


MISTAKES = {
    "it ends elsewhere": (
        {
            "reference": {
                "kind": "spiral",
                "radius": 0.04,
                "length": 0.05,
                "turns": 2,
                "duration": 3,
                "ramp": 0.5,
            }
        },
        {},
        "reference: ends 50 mm and 0.00° from where it starts, so it cannot be repeated; give learn.return_time",
    ),
    "it begins with a jump": (
        {"reference": {"kind": "circle", "radius": 0.05, "duration": 3}},
        {},
        "reference: begins at 105 mm/s and 0.00 °/s, and the jump would be learnt; let it begin at rest",
    ),
    "a model that is not sure": (
        {"law": {"kind": "proportional-feedforward", "gain": 5}},
        {"cutoff": 30, "uncertainty": True},
        "learn.cutoff: with 30 Hz errors grow from",
    ),
    "a model that is not sure of a loop near its limit": (
        {"law": {"kind": "proportional-feedforward", "gain": 5}},
        {
            "cutoff": 12,
            "model": {"kind": "servo", "time_constant": 0.05, "delay": 0.08},
            "uncertainty": {"lag": 0.5, "delay": 0.06},
        },
        "learn.cutoff: with 12 Hz errors grow from 0.89 Hz on",
    ),
    "it is too fast": (
        {"reference": {"kind": "circle", "radius": 0.2, "duration": 0.6, "ramp": 0.1}},
        {},
        "× its largest speed at",
    ),
    "a loop that is unstable": (
        {"law": {"kind": "proportional", "gain": 70}},
        {},
        "law: its loop is unstable with the model: only 0.",
    ),
    "no repeats": ({}, {"repeats": 0}, "learn.repeats: expected a whole number >= 1, got 0"),
    "no such key": ({}, {"repeat": 3}, "learn: unknown key 'repeat'; did you mean 'repeats'"),
    "a law that corrects nothing": ({"law": {"kind": "open-loop"}}, {}, "law: its loop gains are 0"),
    "several laws": (
        {"laws": {"a": {"kind": "proportional", "gain": 1}, "b": {"kind": "proportional", "gain": 2}}},
        {},
        "describes several runs (2 laws); learning takes one",
    ),
}


@pytest.mark.filterwarnings("error::dqcontrol.errors.NoteWarning")
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_clear_line_before_anything_moves(name, monkeypatch):
    changes, block, text = MISTAKES[name]
    data = {key: value for key, value in spec().items() if key != "law" or "laws" not in changes} | changes
    monkeypatch.setattr(
        "dqcontrol.tuning.run_learning.simulate_prepared", lambda *_, **__: pytest.fail("it ran")
    )
    with pytest.raises(Error) as caught:
        dqc.learn(data, **block)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_motion_that_ends_elsewhere_is_learnt_if_the_hand_may_go_back():
    changes, _, _ = MISTAKES["it ends elsewhere"]
    assert dqc.learn(spec(**changes), repeats=2, return_time=3.0).gain > 10


def test_growth_is_recognised_and_the_best_is_kept(monkeypatch):
    """A learning operator that is far too strong: the guard narrows the band, goes back and learns half as much."""
    from dqcontrol.tuning import learnt_motion

    usual = learnt_motion.increment
    monkeypatch.setattr(learnt_motion, "increment", lambda *given: 3.5 * usual(*given))
    found = dqc.learn(spec(), repeats=6)
    errors = [each.learnable for each in found.repeats]
    assert "grown" in [each.outcome for each in found.repeats]
    assert found.repeats[found.best].learnable == min(errors)
    assert found.gain > 20  # without learning less the next repeat grows as much, and all ends


def test_where_nothing_is_gained_the_reference_stays_that_of_the_spec(tmp_path, monkeypatch):
    """Points that sample it are not quite the same motion."""
    from dqcontrol.tuning import learnt_motion

    usual = learnt_motion.increment
    monkeypatch.setattr(learnt_motion, "increment", lambda *given: 20 * usual(*given))
    found = learn_to(spec("proportional-feedforward"), tmp_path / "out", repeats=2)
    assert found.best == 0
    assert found.remarks()[-1] == "gained: nothing; the reference stays that of the spec"
    assert np.array_equal(dqc.run(tmp_path / "out" / "learnt.yaml").q, found.first.q)
    assert not (tmp_path / "out" / "learnt.csv").exists()


def test_a_loop_near_its_limit_is_told_before_anything_moves(monkeypatch):
    """The margin is that of `check`; a shift of the reference may make such a loop swing."""
    data = spec(law={"kind": "proportional", "gain": 30})
    (row,) = check(data)
    ran = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr("dqcontrol.tuning.run_learning.simulate_prepared", ran)
    with (
        pytest.warns(NoteWarning, match=rf"law: {row.worst.margin:.3g} × its gain makes the loop unstable"),
        pytest.raises(KeyboardInterrupt),
    ):
        dqc.learn(data)


@pytest.mark.slow
def test_the_block_may_stand_in_a_file(tmp_path):
    file = tmp_path / "learn.yaml"
    file.write_text(
        yaml.safe_dump(spec() | {"learn": {"repeats": 1, "model": {"kind": "servo", "delay": "20 ms"}}})
    )
    assert len(dqc.learn(file).repeats) == 2
    with pytest.raises(Error, match="run it with 'dqcontrol learn'"):
        dqc.run(file)


def test_a_robot_behind_a_runner_learns_as_a_simulated_one():
    """The runner gives what was measured, over the reference's time; its stamps and samples are its own."""
    problem_of = spec()
    simulated = dqc.learn(problem_of, repeats=2)

    def run(problem, motion, number):
        setting = prepare(problem.data)
        (case,) = setting.cases
        samples = case.scene.samples
        if motion is not None:
            samples = motion.samples(np.minimum(samples[:, 20], motion.duration))
        samples[:, 20] = setting.scene.samples[:, 20]
        record = simulate_prepared(
            case.prepare_law(setting.spec), case.plant, case.scene.start, samples, seed=number
        )
        return replace(record, time=record.time + 5.0)

    behind = dqc.learn(problem_of, repeats=2, runner=run)
    expected = [each.position for each in simulated.repeats]
    assert [each.position for each in behind.repeats] == pytest.approx(expected, rel=1e-6)
    with pytest.raises(Error, match="real_time: a robot behind a runner is always in real time"):
        dqc.learn(problem_of, runner=run, real_time=True)
    with pytest.raises(Error, match=r"learn\.measured_by: the robot's record has no reading 'tracked_pose'"):
        dqc.learn(problem_of, runner=run, measured_by="tracker")

    def tracked(problem, motion, number):
        """A hand 5 mm above where the joints say, as of a tool that is longer."""
        record = run(problem, motion, number)
        poses = shifted_poses(record.pose, np.tile([0.0, 0, 0, 0, 0, 5e-3], (len(record), 1)))
        signal = Signal(TRACKED_POSE, DUAL_QUATERNION, ("",) * 8, poses)
        return replace(record, readings={TRACKED_POSE: signal})

    seen = dqc.learn(problem_of, repeats=4, runner=tracked, measured_by="tracker", skip=0.4)
    assert seen.repeats[0].position > 5
    assert seen.repeats[seen.best].position < 0.2
    assert behind.repeats[behind.best].position < 0.2  # of what the joints say, 5 mm below


def test_what_is_for_ros_is_refused_without_it(tmp_path):
    from dqcontrol.cli.experiment_commands import learn

    (tmp_path / "learn.yaml").write_text(yaml.safe_dump(spec()))
    with pytest.raises(Error, match=r"^--network: is for a robot behind topics; give --ros2 velocity"):
        learn(tmp_path / "learn.yaml", network=True)
    with pytest.raises(Error, match=r"^again: is for a robot behind topics"):
        learn(tmp_path / "learn.yaml", "again")


def test_what_noise_can_make_is_no_growth():
    """A tenth more than the best is growth only where it is more than the noise in the error."""
    assert _outcome(0.9, 1.0, noise=0.05) == "accepted"
    assert _outcome(1.05, 1.0, noise=0.01) == "flat"
    assert _outcome(1.2, 1.0, noise=0.05) == "grown"
    assert _outcome(1.2, 1.0, noise=0.4) == "flat"
    assert _outcome(2.0, 1.0, noise=0.6) == "grown"
