"""Guarded moves and planes that touches find: where the plan goes on, what is written, what is refused."""

from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Admittance, Compliance, WantedWrench
from dqcontrol.errors import Error
from dqcontrol.experiments import check
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.plants import Servo, Wrist
from dqcontrol.references import (
    Circle,
    Guarded,
    OnTouchedPlane,
    Previewed,
    Repeat,
    Search,
    Sequence,
    SetPoint,
    Straight,
)

ARM, START = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, -1.6, 0, 0.9, 0])
HAND = ARM.fkm(START)
PLACE = algebra.translation(HAND)
EXAMPLE = Path(__file__).parents[2] / "examples/writing.yaml"
T = 0.004


def press(**more):
    translation = Compliance(damping=900.0, stiffness=["rigid", "rigid", 0.0])
    return Admittance(axes="base", translation=translation, force=WantedWrench(z=2.0), ramp=0.0, **more)


def simulated(reference, contact, interpreted=False, tilt=3.0, gap=0.005, noise=0.0):
    board = dqc.world.Body(
        box=(0.4, 0.4, 0.04),
        position=(PLACE[0], PLACE[1], PLACE[2] - gap - 0.02),
        rpy=(np.radians(tilt), 0, 0),
        stiffness=2e4,
        friction=0.2,
    )
    wrist = Wrist(filter=0.005, force_noise=noise)
    plant = Servo(time_constant=0.03, delay=0.01, wrist=wrist).in_world(dqc.World(bodies={"board": board}))
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=contact)
    return dqc.simulate(ARM, reference, law, plant, START, T, interpreted=interpreted)


def down_and_aside():
    down = Straight(HAND, way=(0, 0, -0.02), duration=4.0, steady=True)
    low = down.samples([4.0])[0, :8]
    return Sequence([Guarded(down, force=1.0), Straight(low, way=(0.03, 0, 0.01), duration=1.0)])


def test_a_guarded_move_ends_where_it_touches_and_what_follows_goes_on_from_there():
    """Without wanted force the law follows the plan alone: it stays, then moves by what the second part says."""
    free = Admittance(axes="base", translation=Compliance(damping=900.0, stiffness=1e4))
    record = simulated(down_and_aside(), free)
    force = record.readings["touch_force"].values[:, 2]
    touched = int(np.flatnonzero(force > 1.0)[0])
    desired = algebra.translation(record.desired[:, :8])
    held = record.time <= 4.0
    rest = desired[touched + 3 : np.flatnonzero(held)[-1]]
    np.testing.assert_allclose(rest, np.tile(rest[0], (len(rest), 1)), atol=1e-15)
    assert PLACE[2] - 0.007 < rest[0, 2] < PLACE[2] - 0.005  # 5 mm below, and what a period and a newton take
    np.testing.assert_allclose(desired[-1] - rest[0], (0.03, 0, 0.01), atol=1e-4)
    assert np.abs(np.diff(desired, axis=0)).max() < 1.1 * T * 1.875 * 0.032  # no jump


def test_a_guarded_move_that_touches_nothing_goes_to_its_end():
    free = Admittance(axes="base", translation=Compliance(damping=900.0, stiffness=1e4))
    reference = down_and_aside()
    record = simulated(reference, free, gap=0.1)
    np.testing.assert_allclose(record.desired, reference.samples(record.time), atol=1e-12)


def test_touches_are_alike_in_python_and_rollout():
    circle = Circle(HAND, radius=0.03, duration=1.0, plane="xy")
    reference = OnTouchedPlane(circle, height=0.004, depth=0.012, speed=0.02, travel=0.2)
    one, other = (simulated(reference, press(), interpreted, noise=0.05) for interpreted in (False, True))
    for field in ("q", "command", "desired"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))


def test_the_plane_of_three_touches_and_the_twists_of_the_way_to_it():
    circle = Circle(HAND, radius=0.04, duration=2.0, plane="xy")
    reference = OnTouchedPlane(circle)
    record = simulated(reference, press())
    plane = reference.guards.plane
    on = record.time > plane.end + 0.31
    turned = (
        algebra.matrix_from_pose(record.desired[on, :8])[:, :3, :3] @ algebra.matrix_from_pose(HAND)[:3, :3].T
    )
    tilt = np.radians(3.0)
    normal = np.array([0, -np.sin(tilt), np.cos(tilt)])
    assert np.degrees(np.arccos(turned[:, :, 2] @ normal)).max() < 0.1
    middle = PLACE - [0, 0, 0.025]  # of the board, whose upper face is 20 mm above it
    above = (algebra.translation(record.desired[on, :8]) - middle) @ normal - 0.02
    assert np.abs(above).max() < 2e-4
    # the desired twist is the derivative of the desired pose, also while the plan goes over to the plane
    moves = np.flatnonzero((record.time > plane.begin + 2 * T) & (record.time < plane.end - 2 * T))
    pose = record.desired[:, :8]
    change = algebra.multiply(pose[moves + 1], algebra.conjugate(pose[moves - 1]))
    twist = 2 * algebra.log_screw(algebra.short(change)) / (2 * T)
    np.testing.assert_allclose(record.desired[moves, 8:14], twist, atol=1e-5)  # differences of 8 ms


def test_writing_on_a_hard_board_that_is_not_where_it_should_be():
    """2 ± 0.5 N on 98 % of the path at 50 mm/s on 20 kN/m, 5 mm and 3° off, with a bias of 0.5 N; ink ≤ 1 mm."""
    setting = prepare(EXAMPLE)
    plane = setting.cases[0].scene.reference.guards.plane
    run = dqc.run(EXAMPLE)
    assert run.verdict.words.startswith("followed; presses 2")
    assert "s before it touched)" in run.verdict.words
    record = run.record
    writes = record.time > plane.end + 0.3
    force = record.readings["touch_force"].values[writes, 2]
    assert np.mean(np.abs(force - 2.0) <= 0.5) >= 0.98
    assert force.std() < 0.15
    away = (record.position - record.desired_position)[writes]
    assert np.linalg.norm(away[:, :2], axis=1).max() <= 1e-3
    speed = np.linalg.norm(np.diff(record.desired_position[writes], axis=0), axis=1) / T
    assert np.median(speed) == pytest.approx(0.05, abs=1e-3)


def test_a_board_out_of_reach_ends_the_run():
    reference = OnTouchedPlane(Circle(HAND, radius=0.03, duration=1.0, plane="xy"), height=0.004, speed=0.02)
    record = simulated(reference, press(), gap=0.1)
    assert "touches of the reference found no plane" in record.stopped
    assert record.duration < reference.duration


SPEC = {
    "name": "touch", "robot": "iiwa7", "start": START.tolist(), "period": T,
    "law": {"kind": "proportional-feedforward", "gain": 1},
    "plant": {"kind": "servo", "wrist": {}},
    "contact": {
        "axes": "base", "force": {"z": 2}, "translation": {"damping": 200, "stiffness": ["rigid", "rigid", 0]},
    },
}  # fmt: skip
CIRCLE = {"kind": "circle", "radius": 0.03, "duration": 3}
PAUSE = {"kind": "set-point", "duration": 1, "until": {"force": 1}}


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ({"kind": "set-point", "until": {"force": 1}}, "guards a motion that never ends"),
        ({"kind": "set-point", "duration": 1, "until": {"force": 0}}, "until.force"),
        ({"kind": "set-point", "duration": 1, "until": {"drop": -1}}, "until.drop"),
        ({"kind": "set-point", "duration": 1, "until": {}}, "'force' or 'drop'"),
        (CIRCLE | {"touch": {"points": [[0, 0, 0], [1, 0, 0], [2, 0, 0]]}}, "on one line"),
        (CIRCLE | {"touch": {"depth": -1}}, "depth"),
        ({"kind": "sequence", "references": [PAUSE, PAUSE], "repeat": 5}, "10 guarded moves, at most 8"),
        ({"kind": "sequence", "references": [PAUSE], "ramp": 1}, "changes the timing or place of guarded moves"),
    ],
)  # fmt: skip
def test_what_is_refused(reference, words):
    with pytest.raises(Error, match=words) as caught:
        check(SPEC | {"reference": reference})
    assert "\n" not in str(caught.value)


def test_a_move_ends_where_the_hand_drops():
    """Pushed by 2 N down a stage of 100 N·s/m: 20 mm/s, so 5 mm are gone after 250 ms of the guarded second."""
    pause = SetPoint(HAND, duration=0.5)
    search = Search(HAND, radius=0.01, pitch=0.004, speed=0.02)
    contact = Admittance(
        axes="base",
        translation=Compliance(damping=100.0, stiffness=["rigid", "rigid", 0.0]),
        force=WantedWrench(z=2.0),
        ramp=0.0,
    )
    reference = Sequence([pause, Guarded(search, drop=0.005)])
    record = simulated(reference, contact, gap=0.1)
    moved = np.linalg.norm(np.diff(algebra.translation(record.desired[:, :8]), axis=0), axis=1) > 1e-9
    ended = record.time[np.flatnonzero(moved)[-1] + 1]
    assert ended == pytest.approx(0.75, abs=3 * T)


def test_a_drop_goes_by_a_wanted_force():
    spec = SPEC | {"reference": {"kind": "set-point", "duration": 1, "until": {"drop": 1e-3}}}
    spec["contact"] = {"translation": {"damping": 200}}
    with pytest.raises(Error, match=r"until\.drop"):
        check(spec)


def test_touches_need_a_sensor():
    spec = {key: value for key, value in SPEC.items() if key != "contact"}
    with pytest.raises(Error, match="need a force sensor"):
        check(spec | {"reference": PAUSE})
    with pytest.raises(Error, match="need a force sensor"):
        simulated(Guarded(SetPoint(HAND, duration=1.0), 1.0), None)


def test_guards_of_sequences_and_previews_are_later_and_led():
    pause = SetPoint(HAND, duration=1.0)
    whole = Previewed(Sequence([pause, Guarded(pause, 1.0)]), delay=0.01, lag=0.03)
    (move,), plane, lead = whole.guards
    assert (move.begin, move.end, move.force, plane, lead) == (1.0, 2.0, 1.0, None, (0.01, 0.03))
    assert move.drop == np.inf
    assert len(Repeat(Guarded(pause, 1.0), 3).guards.moves) == 3
