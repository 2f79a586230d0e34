"""What the page of play offers beside the gizmo: a sheet to draw on, files, pushes, base targets, replays, clips."""

import asyncio
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from played_spec import PRESS, SPEC

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.browser.play import PlayPage, PlaySession

pytest.importorskip("viser", reason="the browser view needs viser: pip install 'dqcontrol[view]'")
JOHN = {
    **SPEC,
    "robot": "little-john",
    "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
    "period": 0.02,
    "law": {"kind": "feedback-linearization", "stiffness": 4.0, "damping": 4.0},
    "plant": {"kind": "integrator"},
}


@pytest.fixture
def page_of(tmp_path):
    pages = []

    def make(spec):
        pages.append(PlayPage(PlaySession(dict(spec)), tmp_path, 18500))
        return pages[-1]

    yield make
    for page in pages:
        page.server.stop()


def event(phase, start, end, eye=(2.0, 0.5, 1.0)):
    camera = SimpleNamespace(position=np.array(eye))
    return SimpleNamespace(
        phase=phase, start_position=start, end_position=end, client=SimpleNamespace(camera=camera)
    )


def drag_aside(session):
    session.drag(algebra.multiply(algebra.pose([1, 0, 0, 0], [0, 0.1, 0]), session.live.state.pose))


@pytest.mark.parametrize("plane", ["upright", "level"])
def test_the_target_is_where_the_line_of_sight_meets_the_sheet(page_of, plane):
    page = page_of(SPEC)
    board, session = page._target.board, page.session
    hand = session.live.state.pose
    board.show(plane)
    eye = np.array([2.0, 0.5, 1.5])
    wanted = board.centre + 0.05 * board.axes[:, 0] - 0.1 * board.axes[:, 1]
    asyncio.run(board._drawn(event("start", wanted, eye + 0.3 * (wanted - eye), eye)))
    np.testing.assert_allclose(algebra.translation(session.live.target), wanted, atol=1e-12)
    np.testing.assert_allclose(algebra.rotation(session.live.target), algebra.rotation(hand), atol=1e-12)
    assert abs(board.axes[:, 2] @ [0, 0, 1]) == (0.0 if plane == "upright" else 1.0)
    far = board.centre + 10 * board.axes[:, 0]  # beside the sheet: at its edge
    np.testing.assert_allclose(
        board.point(eye, far) - board.centre, board.half * board.axes[:, 0], atol=1e-12
    )
    assert board.point(eye, eye + board.axes[:, 0]) is None  # along the sheet
    assert board.point(eye, eye - (wanted - eye)) is None  # behind the eye
    page.tick()
    assert not page._gizmos[""].visible
    board.show("off")
    page.tick()
    assert page._gizmos[""].visible


def test_a_drawing_file_is_followed_and_kept_beside_the_recordings(page_of, tmp_path):
    page = page_of(SPEC)
    text = b"plane yz\nspeed 0.1\nline 0.1 0\nline 0.1 0.1\n"
    page._target._follow("../l.txt", text)
    assert (tmp_path / "l.txt").read_bytes() == text
    assert page.session.spec["reference"] == {"kind": "drawing", "file": str(tmp_path / "l.txt")}
    start = page.session.live.state.pose
    for _ in range(330):
        page.session.step()
    shift = algebra.translation(page.session.live.state.pose) - algebra.translation(start)
    np.testing.assert_allclose(shift, [0, 0.1, 0.1], atol=2e-3)
    page._target._follow("l.txt", b"nonsense")  # another one of the same name
    assert (tmp_path / "l.txt").read_bytes() == text
    assert page.session.told[-1].startswith("not done: ")
    page._target._follow("l.exe", text)
    assert "expected a drawing" in page.session.told[-1]


def test_a_link_is_pulled_by_the_mouse_where_there_is_physics(page_of):
    mujoco = pytest.importorskip("mujoco")
    page = page_of({**SPEC, "plant": {"kind": "mujoco"}})
    session, row = page.session, 6
    for _ in range(50):
        session.step()
    point = algebra.translation(session.live.state.pose)
    mouse = point + np.array([0, 0.15, 0])
    asyncio.run(page._puller(row)(event("update", point, mouse)))
    np.testing.assert_allclose(session.pulled.force, [0, 30.0, 0], atol=1e-9)
    robot, plant = session.robot, session.live.plant
    expected = np.zeros(7)  # Jᵀ f, by differences of the hand's position
    for j in range(7):
        step = np.zeros(7)
        step[j] = 1e-6
        moved = [algebra.translation(robot.fkm(plant.q + sign * step)) for sign in (1, -1)]
        expected[j] = (moved[0] - moved[1])[1] / 2e-6 * 30.0
    (body,) = np.flatnonzero(plant.data.xfrc_applied.any(axis=1))
    moves, turns = np.zeros((3, 7)), np.zeros((3, 7))
    mujoco.mj_jacBodyCom(plant.model, plant.data, moves, turns, body)
    contact_wrench = plant.data.xfrc_applied[body] @ np.vstack([moves, turns])
    np.testing.assert_allclose(contact_wrench, expected, atol=0.1)  # the data's are a time step old
    farthest = 0.0
    for _ in range(50):
        session.step()
        pulled, hand = session.pulled, algebra.translation(session.live.state.pose)
        farthest = max(farthest, pulled.gave_way)
        np.testing.assert_allclose(pulled.force, 200.0 * (mouse - pulled.point), atol=1e-9)
    np.testing.assert_allclose(pulled.point, hand, atol=1e-3)  # the spring goes along
    assert 1e-3 < farthest < 5e-3  # servos are stiff, and the law takes it back
    assert pulled.gave_way < 0.3 * farthest
    assert session.history[-1].force == pytest.approx(30.0, abs=0.5)
    assert "gives way by" in session.words
    assert "servos and law hold" in session.words
    page.tick()
    assert page._spring[1].text.endswith(" N")
    asyncio.run(page._puller(row)(event("update", point, point + np.array([0, 9.0, 0]))))
    assert np.linalg.norm(session.pulled.force) == pytest.approx(60.0)
    asyncio.run(page._puller(row)(event("end", point, point)))
    assert session.pulled is None
    assert not plant.data.xfrc_applied.any()
    page.tick()
    assert page._spring == []


def test_a_hand_gives_way_to_a_pull_and_comes_back(page_of):
    pytest.importorskip("mujoco")
    page = page_of(SPEC)
    session = page.session
    assert not page._robot._gives_way.visible
    page._robot._plant.value = "physics"
    page.tick()
    assert page._robot._gives_way.visible
    page._robot._gives_way.value = True
    assert session.spec["contact"]["translation"]["stiffness"] == 200.0, session.told
    assert session.live.law.contact is not None
    session.set_law(session.live.law.scaled(1.2))
    assert session.live.law.contact is not None  # another gain keeps it
    for _ in range(50):
        session.step()
    point = algebra.translation(session.live.state.pose)
    session.pull(6, point, point + np.array([0, 0.2, 0]))
    for _ in range(400):
        session.step()
    # Springs of 200 N/m on both sides share the way; 20 N before, 20 N of them left
    assert session.pulled.gave_way == pytest.approx(0.1, abs=0.01)
    assert session.history[-1].force == pytest.approx(20.0, abs=2.0)
    assert "hold against it" not in session.words
    session.pull(6, point, np.full(3, np.nan))
    for _ in range(400):
        session.step()
    assert np.linalg.norm(algebra.translation(session.live.state.pose) - point) < 2e-3
    page._robot._plant.value = "servo"
    assert session.spec["plant"]["kind"] == "servo", session.told
    assert session.spec["contact"] is None


def test_without_physics_nothing_is_pulled(page_of):
    page = page_of(SPEC)
    asyncio.run(page._puller(3)(event("update", np.zeros(3), np.ones(3))))
    assert page.session.pulled is None
    assert "physics" in page.session.told[-1]


@pytest.mark.slow
def test_a_base_drives_to_its_target_and_the_hand_keeps_its_pose_relative_to_it(page_of):
    page = page_of(JOHN)
    session = page.session
    assert page._base is not None
    before, hand = session.live.plant.q.copy(), session.live.state.pose
    half = 0.4
    goal = SimpleNamespace(
        wxyz=np.array([np.cos(half), 0, 0, np.sin(half)]), position=np.array([0.8, 0.5, 0])
    )
    page._base_dragged(SimpleNamespace(phase="start", target=goal))
    assert page._base_held
    page._base_dragged(SimpleNamespace(phase="end", target=goal))
    assert session.spec["reference"]["kind"] == "drive-to", session.told
    for _ in range(1500):
        session.step()
        if session.live.state.time > 1 and np.abs(session.live.control.command).max() < 1e-3:
            break
    wanted = algebra.multiply(algebra.pose(goal.wxyz, goal.position), hand)
    apart = algebra.translation(session.live.state.pose) - algebra.translation(wanted)
    assert np.linalg.norm(apart) < 5e-3
    assert np.linalg.norm(session.live.plant.q[:2] - before[:2]) > 0.3
    page.tick()


def test_arms_on_fixed_bases_have_no_base_target(page_of):
    assert page_of(SPEC)._base is None


def test_a_replay_shows_the_record_while_the_robot_stands_still(page_of):
    page = page_of(SPEC)
    session, tab = page.session, page._replay
    drag_aside(session)
    for _ in range(100):
        session.step()
    record = session.record()
    assert tab.replayed(0.0) is None
    tab._begin_replay()
    assert session.is_paused
    tab.replayed(1.0)
    first = float(tab._time.value)
    q, pose = tab.replayed(1.05)
    at = round((first + 0.05) / 0.01)
    np.testing.assert_array_equal(q, record.q[at])
    np.testing.assert_array_equal(pose, record.desired_pose[at])
    tab._time.value = 0.3  # by hand
    np.testing.assert_array_equal(tab.replayed(1.06)[0], record.q[31])
    page.tick()
    tab._end_replay()
    assert not session.is_paused


def test_a_clip_is_saved(page_of, tmp_path):
    pytest.importorskip("mujoco")
    page = page_of(SPEC)
    drag_aside(page.session)
    for _ in range(30):
        page.session.step()
    page._replay._tried(page._replay._save_clip)
    if "OpenGL" in page._replay._said.content:
        pytest.skip("no OpenGL")
    from PIL import Image

    assert Image.open(tmp_path / "played.webp").n_frames >= 7


@pytest.mark.slow
def test_what_is_copied_as_python_runs(page_of):
    page = page_of(SPEC)
    session = page.session
    drag_aside(session)
    program = page._replay._show_python().removeprefix("```python\n").removesuffix("\n```")
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert float(said.stdout) < 1e-3


@pytest.mark.parametrize(
    ("key", "axis", "sign"), [("left", 1, 1), ("right", 1, -1), ("up", 2, 1), ("down", 2, -1)]
)
def test_arrows_move_the_target_by_two_centimetres(page_of, key, axis, sign):
    page = page_of(SPEC)
    before = algebra.translation(page.session.live.target)
    page._keys[f"arrow{key}"]()
    moved = algebra.translation(page.session.live.target) - before
    np.testing.assert_allclose(moved, 0.02 * sign * np.eye(3)[axis], atol=1e-12)


def test_digits_choose_scenes_and_space_pauses(page_of):
    page = page_of(SPEC)
    page._keys["3"]()
    assert page._target._scene.value.startswith("3. ")
    page._keys["space"]()
    assert page.session.is_paused
    page._keys["space"]()
    assert not page.session.is_paused
    assert {"R", "H", *map(str, range(1, 10))} <= set(page._keys)


def test_a_notebook_plays_in_a_cell_until_it_is_closed(tmp_path):
    shown = dqc.play("iiwa7", folder=tmp_path, port=18510, height=500)
    try:
        assert f'src="{shown.url}"' in shown._repr_html_()
        assert 'height="500"' in shown._repr_html_()
        drag_aside(shown.session)
        while shown.session.live.state.time < 0.1:
            pass
    finally:
        shown.close()
    assert np.abs(shown.session.live.control.command).max() == 0.0
    shown.close()


def test_a_robot_that_is_not_there_is_one_line(tmp_path):
    command = [sys.executable, "-m", "dqcontrol", "play", str(tmp_path / "no.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, ""), "viser says that its server stopped"
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.slow
def test_no_node_of_another_robot_has_a_former_name(page_of):
    """Browsers gave a link of the new robot the place of its namesake where its own is the default one."""
    page, shown = page_of(SPEC), []
    for spec in (JOHN, SPEC, JOHN):
        page.session.play(dict(spec))
        page.tick()
        shown.append({node.name for _, node in page._drawn.bodies} | {page._gizmos[""].name})
    assert len(set.union(*shown)) == sum(map(len, shown))


def test_damping_and_force_of_a_contact_change_while_it_presses(page_of):
    page = page_of(PRESS)
    session, panel = page.session, page._robot._contact
    for _ in range(900):
        session.step()
    assert session.live.control.contact_wrench[5] == pytest.approx(2.0, abs=0.03)
    assert re.fullmatch(r"presses [\d.]+ N along z, 2.00 asked", session.words)
    panel._advise()
    (case,) = session.setting.cases
    limits = dqc.contact.contact_limits(
        case.variant.law.contact.__class__(
            axes="base",
            translation=case.variant.law.contact.translation,
            force=case.variant.law.contact.force,
            sensor=dqc.contact.ForceSensor(filter=0.005),
        ),
        dqc.laws.ProportionalFeedforward(gain=1.0).prepare(session.robot, None, 0.004),
        case.plant,
        SPEC["start"],
        2000,
    )
    sliders = panel._sliders
    assert sliders["board [N/m]"].mark == pytest.approx(limits.stiffness, rel=5e-3)
    assert sliders["Damping [N·s/m]"].mark == pytest.approx(limits.least_damping, rel=5e-3)
    assert f"{sliders['board [N/m]'].mark:g} N/m" in panel._bears.content
    assert (sliders["Damping [N·s/m]"].node.value, sliders["board [N/m]"].node.value) == (100, 2000)

    def move(label, value):
        with panel._lock:  # who finds the limits makes sliders anew meanwhile
            panel._sliders[label].node.value = value

    before = session.live.control.contact_wrench.copy()
    move("Force along z [N]", 3.0)
    session.step()
    assert abs(session.live.control.contact_wrench[5] - before[5]) < 0.05  # the frame stays where it is
    for _ in range(900):
        session.step()
    assert session.live.control.contact_wrench[5] == pytest.approx(3.0, abs=0.03)
    assert re.fullmatch(r"presses [\d.]+ N along z, 3.00 asked", session.words)
    move("Damping [N·s/m]", 60.0)
    assert session.live.law.contact.translation.damping == [0, 0, 60.0]
    assert session.spec["contact"]["translation"]["damping"] == [0, 0, 60.0]
    move("Damping [N·s/m]", 20.0)  # unstable: refused, and shown as it is
    assert "damping must be above 33" in session.told[-1]
    assert session.live.law.contact.translation.damping == [0, 0, 60.0]
    assert sliders["Damping [N·s/m]"].node.value == 60.0
    move("board [N/m]", 3000.0)  # another board: from the air again
    assert session.spec["world"]["board"]["stiffness"] == 3000.0, session.told
    assert session.live.control.contact_wrench[5] == 0.0
    for _ in range(900):
        session.step()
    assert session.live.control.contact_wrench[5] == pytest.approx(3.0, abs=0.03)
    assert re.fullmatch(r"presses [\d.]+ N along z, 3.00 asked", session.words)
    move("board [N/m]", 8000.0)
    assert "not done: contact: world.board has 8000 N/m, but" in session.told[-1]
    assert panel._sliders["board [N/m]"].node.value == 3000.0


def test_without_contact_its_panel_is_not_there(page_of):
    page = page_of(SPEC)
    assert not page._robot._contact._folder.visible
    assert page.session.live.control.contact_wrench.tolist() == [0.0] * 6
