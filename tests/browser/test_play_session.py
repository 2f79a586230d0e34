"""A session of play without a browser: what is saved gives the same run again, and changes are told in words."""

import sys
import threading
import time

import numpy as np
import pytest
from played_spec import SPEC as IIWA

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.browser.play import SCENES, PlaySession
from dqcontrol.browser.play.learnt import learn_in
from dqcontrol.browser.play.session import RecordedRows, law_data, law_from
from dqcontrol.errors import Error, ExistsError
from dqcontrol.experiments.driven import driven_spec

NOISY = {"kind": "servo", "delay": 0.02, "encoder_noise": 1e-4}
SPEC = {**IIWA, "plant": NOISY}


def moved(pose, shift):
    return algebra.multiply(algebra.pose([1, 0, 0, 0], shift), pose)


def steps(session, count):
    for _ in range(count):
        session.step()


def wave(session, count, far=0.1):
    """Drag the target about, as a hand does."""
    start = session.live.state.pose
    for k in range(count):
        if k % 3 == 0:
            session.drag(
                moved(start, [0.3 * far * np.sin(k / 40), far * np.sin(k / 60), far * (1 - np.cos(k / 50))])
            )
        session.step()


@pytest.mark.parametrize(
    "plant",
    [NOISY, {"kind": "integrator"}],
    ids=lambda plant: plant["kind"],
)
def test_what_is_saved_gives_the_same_joints_again(tmp_path, plant):
    session = PlaySession({**SPEC, "plant": plant})
    wave(session, 500)
    said = session.save(tmp_path / "waved.yaml")
    record, again = session.record(), dqc.run(tmp_path / "waved.yaml").record
    assert len(record) == 500
    assert np.ptp(record.position, axis=0).max() > 0.1
    np.testing.assert_allclose(again.q[:500], record.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again.command[:500], record.command, rtol=0, atol=1e-9)
    assert float(said.split("at most ")[1].split()[0]) < 1e-9
    with pytest.raises(ExistsError, match="exists already"):
        session.save(tmp_path / "waved.yaml")


def test_a_target_out_of_reach_is_saved_too(tmp_path):
    session = PlaySession(SPEC)
    session.drag(moved(session.live.state.pose, [2.0, 0.0, 0.0]))
    steps(session, 900)
    assert session.words.endswith("mm to go") or session.words.endswith("mm out of reach")
    session.save(tmp_path / "far.yaml")
    with pytest.warns(dqc.errors.LimitWarning, match="out of reach"):
        again = dqc.run(tmp_path / "far.yaml").record
    np.testing.assert_allclose(again.q[:900], session.record().q, rtol=0, atol=1e-9)


def test_a_circle_is_saved_as_one_and_a_drag_ends_it(tmp_path):
    session = PlaySession(SPEC)
    assert session.follow({"kind": "circle", "radius": 0.05, "duration": 20.0, "turns": 4, "plane": "yz"})
    steps(session, 300)
    session.save(tmp_path / "circle.yaml")
    assert not (tmp_path / "circle.csv").exists()
    again = dqc.run(tmp_path / "circle.yaml").record
    np.testing.assert_allclose(again.q[:300], session.record().q, rtol=0, atol=1e-9)
    before = session.live.control.command.copy()
    session.drag(session.live.state.pose)
    session.step()
    assert np.abs(session.live.control.command - before).max() < 0.11  # 10 rad/s² in 10 ms: no jump
    assert len(session.record()) == 1  # what follows is another run


def test_another_law_goes_on_without_a_stop_and_is_exact_again_once_all_rests(tmp_path):
    session = PlaySession(IIWA)
    wave(session, 100)
    assert session.set_law(session.live.law.scaled(2.0))
    assert session.spec["law"] == {"kind": "proportional-feedforward", "gain": 10.0}
    wave(session, 100)
    assert "let the robot rest" in session.save(tmp_path / "a.yaml")
    steps(session, 800)
    wave(session, 100)
    said = session.save(tmp_path / "b.yaml")
    assert float(said.split("at most ")[1].split()[0]) < 1e-9


def test_what_cannot_be_is_said_and_changes_nothing():
    session = PlaySession(SPEC)
    spec, live = session.spec, session.live
    assert not session.change(period=-1.0)
    assert session.told[-1].startswith("not done: ")
    assert "period" in session.told[-1]
    assert not session.change(world={"ball": {"sphere": -1.0, "position": [1, 0, 0]}})
    assert session.spec is spec
    assert session.live is live


def test_a_second_robot_runs_another_law_under_the_same_target():
    session = PlaySession(SPEC)
    assert session.set_ghost({"kind": "proportional", "gain": 1.0})
    assert session.follow({"kind": "circle", "radius": 0.05, "duration": 20.0, "turns": 4, "plane": "yz"})
    steps(session, 400)
    assert session.ghost is not None
    assert session.ghost.state.position_error > 5 * session.live.state.position_error
    np.testing.assert_array_equal(session.ghost.state.desired, session.live.state.desired)
    assert session.set_ghost(None)
    assert session.ghost is None


def test_bodies_and_constraints_keep_the_hand_away():
    session = PlaySession({**SPEC, "plant": {"kind": "integrator"}})
    hand = algebra.translation(session.live.state.pose)
    ball = {"sphere": 0.05, "position": np.add(hand, [0, 0.2, 0]).tolist()}
    kept = {"clear_of": "all", "margin": 0.01, "acceleration": 10.0}
    assert session.change(world={"ball": ball}, constraints=kept)
    session.drag(moved(session.live.state.pose, [0, 0.2, 0]))  # into the ball
    steps(session, 600)
    rooms = [moment.clearance for moment in session.history if np.isfinite(moment.clearance)]
    assert min(rooms) > -1e-6
    assert rooms[-1] < 0.02
    assert session.set_law(session.live.law.scaled(1.2))
    assert session.live.law.constraints is not None  # another gain keeps it all


def test_a_reset_puts_it_back_and_hold_lets_it_rest():
    session = PlaySession(SPEC)
    wave(session, 200)
    session.hold()
    steps(session, 200)
    assert np.abs(session.live.control.command).max() < 0.02
    session.reset()
    np.testing.assert_array_equal(session.live.plant.q, SPEC["start"])


def test_the_thread_steps_at_its_period_and_pauses():
    with PlaySession(SPEC) as session:
        while session.live.state.time < 0.2:
            pass
        with session.lock:
            session.is_paused = True
            time = session.live.state.time
        for _ in range(1000):
            assert session.live.state.time == time
        assert session.words.startswith("paused")


def test_the_program_drives_the_same_robot(capsys):
    session = PlaySession(SPEC)
    session.drag(moved(session.live.state.pose, [0, 0.05, 0]))
    steps(session, 20)
    exec(session.python(), {})
    assert float(capsys.readouterr().out) < 1e-3


def test_rows_are_kept_until_they_are_many():
    arm = dqc.load_robot("iiwa7")
    rows = RecordedRows(arm, 1500)
    for k in range(1600):
        sample = np.concatenate([arm.fkm(np.zeros(7)), np.zeros(12), [0.01 * k]])
        rows.take(sample, np.full(7, k * 1e-4), np.zeros(7), np.zeros(7))
    assert rows.is_full
    assert len(rows.record()) == len(rows) == 1500
    assert rows.record().q[-1, 0] == 1499e-4


def test_laws_are_said_without_their_defaults():
    data = {"kind": "feedback-linearization", "stiffness": 4.0, "damping": 4.0}
    assert law_data(law_from(data)) == data
    with pytest.raises(Error, match="law"):
        law_from({"kind": "nothing"})


def test_words_are_said_while_the_thread_adds_to_what_happened():
    """Ended the server once: a deque must not grow while it is looped over."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        session = PlaySession(SPEC)
        for _ in range(40):
            session._note()
        noting = threading.Thread(target=lambda: [session._note() for _ in range(4000)])
        noting.start()
        while noting.is_alive():
            assert session.words
        noting.join()
    finally:
        sys.setswitchinterval(before)


def test_a_circle_is_learnt_repeat_by_repeat_until_the_robot_is_told_something_else():
    (scene,) = (scene for scene in SCENES if scene.learns)
    session = PlaySession(dict(scene.spec))
    learning = learn_in(session, 2)
    while learning.is_alive():
        with session.lock:
            for _ in range(50):
                session.step()
        time.sleep(1e-3)  # the learner's turn
    said = session.told[-1]
    errors = [float(each) for each in said.split(" by ")[1].split(" mm")[0].split(", ")]
    assert len(errors) == 3, list(session.told)
    assert errors[2] < 0.4 * errors[0]

    session.begin(dict(scene.spec))
    learning = learn_in(session, 2)
    rows = session.rows
    while session.rows is rows:
        time.sleep(1e-3)
    session.hold()
    learning.join()
    assert session.told[-1] == said


def test_the_scene_of_a_board_presses_with_what_it_says():
    (scene,) = (scene for scene in SCENES if "board" in scene.title)
    session = PlaySession(dict(scene.spec))
    steps(session, 1500)
    forces = [moment.force for moment in list(session.history)[-60:]]
    assert np.median(forces) == pytest.approx(2.0, abs=0.5)


def hands(session):
    return {name: session.robot.fkm(session.live.plant.q, name) for name in ("left", "right")}


def shifts(before, after):
    return [algebra.translation(after[name]) - algebra.translation(before[name]) for name in before]


def test_each_of_two_arms_goes_where_it_is_dragged_and_what_is_saved_is_the_same_again(tmp_path):
    session = PlaySession(driven_spec("two-pandas")[0])
    assert list(session.ends.handles) == ["left", "right"]
    before = hands(session)
    session.drag(moved(before["left"], [0.05, 0, 0.05]), "left")
    steps(session, 400)
    np.testing.assert_allclose(shifts(before, hands(session)), [[0.05, 0, 0.05], [0, 0, 0]], atol=1e-3)
    session.drag(moved(before["right"], [0, -0.06, 0]), "right")
    steps(session, 50)
    assert session.words.endswith("mm to go")  # of the right one: the left one is there
    assert session.ends.labels == ("left", "right")
    point, right = session.history[-1], session.live.state.q
    away = session.robot.fkm(right, "right")
    lag = np.linalg.norm(algebra.translation(session.live.aimed(0)) - algebra.translation(away))
    assert point.error < 1e-4 < 0.005 < point.further_error == pytest.approx(lag, abs=3e-3)
    steps(session, 350)
    np.testing.assert_allclose(shifts(before, hands(session)), [[0.05, 0, 0.05], [0, -0.06, 0]], atol=1e-3)
    session.save(tmp_path / "both.yaml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["both-task-1.csv", "both.csv", "both.yaml"]
    again = dqc.run(tmp_path / "both.yaml").record
    np.testing.assert_allclose(again.q[:800], session.record().q, rtol=0, atol=1e-9)
    session.drag(moved(before["right"], [0, 0.06, 0]), "right")
    steps(session, 20)
    session.hold()
    steps(session, 200)
    assert np.abs(session.live.control.command).max() < 1e-3
    session.drag(moved(before["right"], [0, 0.06, 0]), "right")
    session.live.target = before["left"]  # as a device says
    steps(session, 10)
    for name, pose in hands(session).items():  # its arrows go along with it
        np.testing.assert_array_equal(session.ends.handles[name], pose)


def test_a_tray_goes_along_as_it_is_held_and_by_one_hand_what_both_hold_changes():
    (scene,) = (scene for scene in SCENES if "tray" in scene.title)
    session = PlaySession(dict(scene.spec))
    assert session.ends.handles.keys() == {"left", "right", ""}
    before, held = hands(session), session.robot.relative_pose(session.live.plant.q)
    session.drag(moved(session.ends.handles[""], [0, 0.05, -0.05]))
    for _ in range(400):
        session.step()
        apart = session.robot.relative_pose(session.live.plant.q) - held
        assert np.abs(apart).max() < 1e-3  # they hold it on the way
    np.testing.assert_allclose(shifts(before, hands(session)), [[0, 0.05, -0.05]] * 2, atol=1e-3)
    before = hands(session)
    session.drag(moved(before["left"], [0.05, 0, 0.05]), "left")
    steps(session, 400)
    np.testing.assert_allclose(shifts(before, hands(session)), [[0.05, 0, 0.05], [0, 0, 0]], atol=1e-3)


def test_a_relative_target_is_dragged_where_it_is_seen():
    """One hand seen from the other: the arrows are at that hand, not at the base."""
    (scene,) = (scene for scene in SCENES if "tray" in scene.title)
    spec = {**scene.spec, "robot": {"source": "two-pandas", "task": "relative"}, "tasks": None}
    session = PlaySession(spec)
    ((name, handle),) = session.ends.handles.items()
    np.testing.assert_allclose(handle, hands(session)["left"], atol=1e-12)
    session.drag(moved(handle, [0, 0, 0.03]), name)
    right = hands(session)["right"]
    wanted = algebra.multiply(algebra.conjugate(right), moved(handle, [0, 0, 0.03]))
    np.testing.assert_allclose(session.live.target, wanted, atol=1e-12)


def test_a_further_task_that_moves_by_itself_rests_once_an_end_effector_is_dragged():
    spec = driven_spec("two-pandas")[0]
    circle = {"kind": "circle", "radius": 0.03, "duration": 60.0, "turns": 12.0, "plane": "yz"}
    session = PlaySession({**spec, "tasks": [{**spec["tasks"][0], "reference": circle}]})
    steps(session, 100)
    session.drag(hands(session)["left"], "left")
    steps(session, 200)
    assert np.abs(session.live.control.command).max() < 1e-3
    assert "reference" not in session.spec["tasks"][0]
