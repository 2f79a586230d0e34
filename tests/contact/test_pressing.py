"""Force control in the loop: compiled and interpreted alike, steady, and refused where it cannot be."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from msgspec.structs import replace

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Admittance, Compliance, ForceSensor, Tool, WantedWrench
from dqcontrol.errors import Error
from dqcontrol.experiments import check
from dqcontrol.plants import Servo, Wrist

ARM, START = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, -1.6, 0, 0.9, 0])
HAND = ARM.fkm(START)
PLACE = algebra.translation(HAND)
EXAMPLE = Path(__file__).parents[2] / "examples/press.yaml"


def board(stiffness, gap=0.005, **more):
    middle = (PLACE[0], PLACE[1], PLACE[2] - gap - 0.02)
    return dqc.World(
        bodies={"board": dqc.world.Body(box=(0.6, 0.6, 0.04), position=middle, stiffness=stiffness, **more)}
    )


def push(damping, **more):
    translation = Compliance(damping=damping, stiffness=["rigid", "rigid", 0.0])
    return Admittance(axes="base", translation=translation, force=WantedWrench(z=2.0), **more)


def pressed(stiffness, seconds, wrist, contact, interpreted=False, **more):
    plant = Servo(time_constant=0.04, delay=0.012, wrist=wrist).in_world(board(stiffness, **more))
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=contact)
    return dqc.simulate(
        ARM, dqc.references.SetPoint(HAND), law, plant, START, 0.004, seconds, interpreted=interpreted
    )


def test_rollout_and_python_are_bit_equal():
    wrist = Wrist(filter=0.005, force_noise=0.1, torque_noise=0.01, mass=0.3, center=(0, 0, 0.04))
    sensor = ForceSensor(tool=Tool(mass=0.3, center=(0, 0, 0.04)), tare=0.1)
    one, other = (
        pressed(2000, 2.0, wrist, push(100.0, sensor=sensor), interpreted, friction=0.3)
        for interpreted in (False, True)
    )
    for field in ("q", "command", "measured"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
    for name in ("wrist_force", "wrist_torque", "touch_force", "touch_depth"):
        np.testing.assert_array_equal(one.readings[name].values, other.readings[name].values)
    assert one.readings["touch_force"].values[:, 2].max() > 1.5


@pytest.mark.parametrize(("stiffness", "seconds"), [(1e3, 8.0), (1e4, 8.0), (1e5, 60.0)])
def test_steady_force_on_walls(stiffness, seconds):
    """Within 1 % after the weight and bias of a tool are taken off, with the damping that the note advises."""
    load = {
        "mass": 0.5,
        "center": (0.01, 0.0, 0.05),
        "force_bias": (0.3, -0.2, 0.5),
        "torque_bias": (0.02, 0.01, 0.0),
    }
    tool, wrist = Tool(**load), Wrist(filter=0.005, **load)
    contact = push(2 * stiffness / 48, sensor=ForceSensor(filter=0.005, tool=tool))
    force = pressed(stiffness, seconds, wrist, contact).readings["touch_force"].values[:, 2]
    assert abs(force[-1] - 2.0) < 0.01 * 2.0
    assert force.max() < 2.0 * 2.0


def test_a_tare_in_the_air_takes_a_bias_off_that_nobody_knows():
    wrist = Wrist(filter=0.005, force_bias=(0.3, -0.2, 0.5), torque_bias=(0.02, 0.0, -0.01))
    forces = [
        pressed(2e3, 6.0, wrist, push(84.0, sensor=ForceSensor(filter=0.005, tare=tare)))
        .readings["touch_force"].values[-1, 2]
        for tare in (0.0, 0.5)
    ]  # fmt: skip
    assert abs(forces[0] - 2.0) > 0.3  # the bias is in the force
    assert abs(forces[1] - 2.0) < 0.02


def test_a_reference_that_moves_during_the_tare_is_refused():
    circle = {"kind": "circle", "plane": "xy", "radius": 0.02, "duration": 12}
    contact = spec()["contact"] | {"sensor": {"tare": 0.5}}
    with pytest.raises(Error, match=r"contact\.sensor\.tare: the reference moves from 0.004 s on"):
        check(spec(reference=circle, contact=contact))


def test_pressing_on_a_board_that_is_not_where_it_should_be():
    record = dqc.run(EXAMPLE).record
    force = record.readings["touch_force"].values
    settled = record.time > 3.0
    pressing = np.linalg.norm(force[settled], axis=1)
    assert np.mean(np.abs(force[settled][:, 2] - 2.0) <= 0.5) >= 0.98
    assert pressing.min() > 0.5


def spec(**changes):
    data = {
        "name": "press", "robot": "iiwa7", "start": START.tolist(), "period": 0.004,
        "reference": {"kind": "set-point", "duration": 1},
        "law": {"kind": "proportional-feedforward", "gain": 1},
        "contact": {
            "axes": "base", "force": {"z": 2},
            "translation": {"damping": 200, "stiffness": ["rigid", "rigid", 0]},
        },
        "world": {"board": {"box": [0.6, 0.6, 0.04], "position": [0.55, 0, 0.28], "stiffness": 2000}},
        "plant": {"kind": "servo", "time_constant": 0.04, "delay": 0.012, "wrist": {}},
    }  # fmt: skip
    return data | changes


PRESSING = spec()["contact"]


def test_what_fits_is_not_refused():
    tool = {"mass": 0.3, "center": [0, 0, 0.02]}
    wrist = {"kind": "servo", "wrist": {**tool, "force_noise": 0.1}}
    slow = {"kind": "straight", "way": [0, 0, -0.02], "duration": 4}
    found = check(
        spec(
            contact=PRESSING | {"sensor": {"tool": tool}, "limits": {"depth": 0.01}},
            plant=wrist,
            reference=slow,
        )
    )
    assert found.contact is not None


def test_check_says_what_the_knobs_mean():
    checks = check(spec())
    assert checks.contact is not None
    text = " ".join(str(checks).split())  # lines are as long as the terminal is wide
    for words in ("bears up to", "moves the end effector in free space at 10 mm/s", "approach no faster"):
        assert words in text, text


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"plant": {"kind": "servo"}}, "plant 'servo' measures no wrench"),
        ({"world": {"wall": {"box": 0.2, "position": [0.55, 0, 0.17], "stiffness": 1e5}}}, r"wall has 1e\+05 N/m"),
        ({"world": {"wall": {"box": 0.2, "position": [0.55, 0, 0.25], "stiffness": 100}}}, "mm inside of what"),
        ({"world": {"ball": {"sphere": 0.1, "position": [0.55, 0, 0], "stiffness": 100}}}, "touch springy boxes alone"),
        ({"contact": {"translation": {"stiffness": 5}}}, "mass and damping are both 0"),
        ({"contact": {"translation": {"damping": -5}}}, "damping"),
        ({"contact": {"translation": {"damping": 5}, "sensor": {"position": [1, 2]}}}, "contact.sensor.position"),
        ({"contact": PRESSING | {"sensor": {"tool": {"mass": 1.2}}}}, "leaves 11.8 N .* that of another tool"),
        ({"reference": {"kind": "straight", "way": [0, 0, -0.05], "duration": 1}}, "board at 68.6 mm/s, at t = "),
        ({"contact": PRESSING | {"limits": {"depth": 0.005}}}, "nothing springy comes nearer than 0.008"),
    ],
)  # fmt: skip
def test_what_is_refused_before_anything_moves(changes, words):
    with pytest.raises(Error, match=words) as caught:
        check(spec(**changes))
    assert "\n" not in str(caught.value)


def test_a_law_that_was_not_asked_yet_hears_what_left():
    """As after gains have changed, in a period in which no measurement came."""
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=push(100.0)).prepare(ARM, None, 0.004)
    state = law.initial_state(START)
    law.sent(state, np.full(7, 0.1))
    assert np.isfinite(state).all()


def test_axes_that_turn_hide_no_unstable_contact():
    """What they bear is N·m/rad, a smaller number."""
    wall = {"wall": {"box": 0.2, "position": [0.55, 0, 0.17], "stiffness": 1e5}}
    contact = spec()["contact"] | {"rotation": {"damping": 5, "stiffness": 4}}
    with pytest.raises(Error, match=r"wall has 1e\+05 N/m, but along z this loop is unstable"):
        check(spec(world=wall, contact=contact))


def test_unstable_contact_runs_if_that_is_asked_for():
    wall = {"wall": {"box": 0.2, "position": [0.55, 0, 0.17], "stiffness": 1e5}}
    contact = spec()["contact"] | {"allow_unstable": True}
    assert check(spec(world=wall, contact=contact)).contact is not None


def test_a_run_that_presses_says_how_hard_and_is_not_judged_by_where_it_gives_way():
    run = dqc.run(spec(reference={"kind": "circle", "plane": "xy", "radius": 0.02, "duration": 12}))
    assert run.verdict.words.startswith("followed; presses ")
    assert "N along z, 2 asked" in run.verdict.words
    assert not run.verdict.failure
    air = dqc.run(
        spec(world={"board": {"box": [0.6, 0.6, 0.04], "position": [0.55, 0, -0.5], "stiffness": 2000}})
    )
    assert air.verdict.words.startswith("touched nothing; ")
    assert air.verdict.failure == "task"


def held_back(seconds, **bounds):
    """Come down 30 mm by force at 20 mm/s, where a supervisor lets the hand go no faster than 10 mm/s."""
    supervisor = dqc.supervisor.Supervisor(
        **{"ramp": 0.0, "slow_below": 0.0, "hold_below": 0.0, "tracking_error": 10.0, **bounds}
    )
    plant = Servo(time_constant=0.04, wrist=Wrist()).in_world(board(1e3, gap=0.03))
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=push(100.0, ramp=0.0))
    return [
        dqc.simulate(
            ARM, dqc.references.SetPoint(HAND), law, plant, START, 0.004, seconds,
            supervisor=supervisor, interpreted=interpreted,
        )
        for interpreted in (False, True)
    ]  # fmt: skip


def test_what_a_supervisor_holds_back_does_not_wind_up():
    """Without, the frame is ahead of the hand when that touches, and the force peaks at 7.7 N."""
    record, again = held_back(9.0, hand_speed=0.01)
    force = record.readings["touch_force"].values[:, 2]
    assert force.max() < 2.0 * 1.5
    assert force[-1] == pytest.approx(2.0, abs=0.1)
    height = algebra.translation(record.pose)[:, 2]
    assert np.abs(np.diff(height)).max() / 0.004 < 0.011  # it was held
    np.testing.assert_array_equal(record.q, again.q)


def test_a_loop_that_no_damping_makes_stable_is_said_so(tmp_path):
    path = tmp_path / "press.yaml"
    path.write_text(
        EXAMPLE.read_text(encoding="utf-8").replace("gain: 1}", "gain: 1.0e+300}"), encoding="utf-8"
    )
    with pytest.raises(Error, match="unstable from 0 N/m on; no damping makes it stable"):
        check(path)


def test_gains_change_without_a_jump_while_it_presses():
    """From 2 N and 200 N·s/m to 100 N·s/m, another law's gain, and 3 N."""
    plant = Servo(time_constant=0.04, delay=0.012, wrist=Wrist()).in_world(board(1000.0))
    pressing = push(200.0)
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=pressing)
    live = dqc.loop.Live(ARM, law, plant, 0.004, start=START)
    for _ in range(1500):
        live.step()
    assert -live.plant.wrench[2] == pytest.approx(2.0, rel=0.01)
    lighter = replace(pressing, translation=Compliance(damping=100.0, stiffness=["rigid", "rigid", 0.0]))
    for change in (
        replace(law, contact=lighter),
        replace(law, gain=2.0, contact=lighter),
        replace(law, contact=replace(lighter, force=WantedWrench(z=3.0))),
    ):
        live.set_law(change)
        forces = []
        for _ in range(1500):
            live.step()
            forces.append(-live.plant.wrench[2])
        assert min(forces) > 1.98  # a compliant frame that began anew would let go
        assert max(forces) < 3.1  # a step by 1 N, late by 56 ms
    assert -live.plant.wrench[2] == pytest.approx(3.0, rel=0.01)
    turning = {"rotation": Compliance(damping=1.0), "translation": "rigid", "force": WantedWrench()}
    for words, bad in (("cannot become rigid", turning), ("contact.axes", {"axes": "hand"})):
        contact = replace(pressing, **bad)
        with pytest.raises(Error, match=words):
            live.set_law(replace(law, contact=contact))
    assert live.law is change  # which goes on


def test_a_hand_leads_an_arm_that_stays_where_it_is_let_go():
    """A push of 12 N for a second at M = 2 kg and D = 60 N·s/m; M v̇ + D v = F beyond the dead band, then it rests."""
    pytest.importorskip("mujoco")
    path = Path(__file__).parents[2] / "examples/leading.yaml"
    spec = yaml.safe_load(path.read_text())
    spec["reference"]["duration"] = 3.0
    del spec["plant"]["pushes"][1:]
    record = dqc.run(spec).record
    way = record.position - record.position[0]
    assert way[-1, 1] == pytest.approx((12 - 1) / 60, rel=0.02)  # M v ends where it begins, at 0: D y = ∫ F
    assert np.abs(way[:, [0, 2]]).max() < 0.005
    assert (
        np.linalg.norm(way[-1] - way[-125]) < 3e-3
    )  # m in the last half second: a gain of 1/s brings the rest
    assert np.abs(way[record.time < 1.0]).max() < 1e-5
