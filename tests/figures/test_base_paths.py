"""Figures of robots that drive, and of several runs laid over each other."""

import matplotlib.quiver
import numpy as np
import pytest
from mpl_toolkits.mplot3d import proj3d

import dqcontrol as dqc
from dqcontrol.errors import ShapeError
from dqcontrol.figures import base_path, compare_inputs, compare_joints, compare_poses, superimposed

START = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])


@pytest.fixture(scope="module")
def body():
    return dqc.load_robot("little-john")


@pytest.fixture(scope="module")
def records(body):
    goal = dqc.references.SetPoint(body.fkm(START + np.array([0.6, 0.3, 0.5, 0.2, 0, 0, 0, 0])))
    return {
        f"k = {gain}": dqc.simulate(
            body, goal, dqc.laws.Proportional(gain=gain), dqc.plants.Integrator(), START, 0.05, 3.0
        )
        for gain in (0.5, 1.0)
    }


def test_a_base_path_shows_where_the_base_went_and_faced(body, records):
    figure = base_path(body, records)
    (axes,) = figure.axes
    for label, record in records.items():
        (line,) = (line for line in axes.lines if line.get_label() == label)
        np.testing.assert_allclose(np.transpose(line.get_data()), record.q[:, :2], atol=1e-12)
    arrows = [each for each in axes.collections if isinstance(each, matplotlib.quiver.Quiver)]
    last = records["k = 1.0"].q[-1, 2]
    np.testing.assert_allclose([arrows[1].U[-1], arrows[1].V[-1]], [np.cos(last), np.sin(last)], atol=1e-12)


def test_superimposed_robots_start_and_end_where_the_run_did(body, records):
    axes = superimposed(body, records, poses=4).axes[0]
    hands = [np.array(line.get_data_3d())[:, -1] for line in axes.lines if line.get_marker() == "o"]
    assert len(hands) == 8
    for i, record in enumerate(records.values()):
        np.testing.assert_allclose(hands[4 * i], record.position[0], atol=1e-12)
        np.testing.assert_allclose(hands[4 * i + 3], record.position[-1], atol=1e-12)


def test_all_of_a_long_way_is_seen(body):
    """Goal and hand at the far corner: their pixels are drawn, and lie on the canvas."""
    q = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    goal = dqc.references.SetPoint(body.fkm(q + np.array([1.6, 1.3, 0, 0, 0, 0, 0, 0])))
    law = dqc.laws.FeedbackLinearization(stiffness=1.0, damping=1.0)
    record = dqc.simulate(body, goal, law, dqc.plants.Integrator(), q, 0.05, 10.0)
    figure = superimposed(body, {"": record})
    figure.draw_without_rendering()
    width, height = figure.canvas.get_width_height()
    axes = figure.axes[0]
    for line in axes.lines:
        x, y, _ = proj3d.proj_transform(*line.get_data_3d(), axes.get_proj())
        pixels = axes.transData.transform(np.column_stack([x, y]))
        assert (pixels > 0).all()
        assert (pixels < [width, height]).all()
        assert not line.get_clip_on()


def test_an_arm_alone_can_be_superimposed_but_has_no_base_path():
    arm, q = dqc.load_robot("ax18"), np.array([0, -0.9, 0.9, 0.9, 0])
    goal = dqc.references.SetPoint(arm.fkm(q + 0.2))
    record = dqc.simulate(arm, goal, dqc.laws.Proportional(gain=1.0), dqc.plants.Integrator(), q, 0.05, 1.0)
    line = next(each for each in superimposed(arm, {"": record}).axes[0].lines if each.get_marker() == "o")
    np.testing.assert_allclose(np.array(line.get_data_3d())[:, -1], record.position[0], atol=1e-12)
    with pytest.raises(ShapeError, match="mobile base"):
        base_path(arm, {"": record})


def test_poses_of_runs_have_the_sign_of_the_desired_one(records):
    turned = {}
    for i, (label, record) in enumerate(records.items()):
        desired = record.desired.copy()
        desired[:, :8] *= (-1) ** i
        turned[label] = dqc.loop.Record(
            record.time, record.q, record.q, record.command, (-1) ** i * record.pose, desired,
            record.joint_names, record.input_names,
        )  # fmt: skip
    for figure in (compare_poses(records), compare_poses(turned)):
        for k, axes in enumerate(figure.axes):
            ends = [line.get_ydata()[-1] for line in axes.lines]
            assert ends[:2] == pytest.approx([ends[2]] * 2, abs=0.15), k


def test_joints_and_inputs_of_runs(body, records):
    panels = compare_joints(records, body.limits, range(3, 8), span=(1.0, 2.0)).axes
    by_title = {axes.get_title(loc="left"): axes for axes in panels}
    for i in range(3, 8):
        axes = by_title[body.joint_names[i]]
        drawn = axes.lines[0].get_ydata()
        np.testing.assert_allclose(drawn, np.degrees(records["k = 0.5"].q[:, i]))
        assert axes.lines[2].get_ydata()[0] == pytest.approx(-150)
    told = {label: (record.time, record.command) for label, record in records.items()}
    panels = compare_inputs(told, body.input_names).axes
    np.testing.assert_array_equal(panels[0].lines[1].get_ydata(), records["k = 1.0"].command[:, 0])


def test_nothing_to_draw(body, records):
    for draw in (
        lambda: superimposed(body, {}),
        lambda: compare_poses({}),
        lambda: compare_inputs({}, ["a"]),
    ):
        with pytest.raises(ShapeError):
            draw()
    with pytest.raises(ShapeError, match="at least 2"):
        superimposed(body, records, poses=1)
