import numpy as np
import pytest
from test_plots import drawn, run, shifted

from dqcontrol.errors import ShapeError
from dqcontrol.figures.comparisons import compare_criteria, criteria_side_by_side
from dqcontrol.loop.record import Record

pytestmark = pytest.mark.filterwarnings("error")


def panels(figure):
    return {axes.get_ylabel(): axes for axes in drawn(figure)}


def changed(record, **arrays):
    names = ("time", "q", "measured", "command", "pose", "desired")
    values = {name: getattr(record, name) for name in names} | arrays
    return Record(*values.values(), record.joint_names)


@pytest.mark.slow
def test_criteria_are_the_norms_that_the_metrics_integrate():
    record = run(count=80)
    shown = panels(compare_criteria({"K": record}))
    assert len(shown) == 12
    step = record.time[1] - record.time[0]
    expected = {
        "$|1 - x^{*} x_d|$": np.full(80, 0.005),
        "control\n[rad/s or m/s]": np.linalg.norm(record.command, axis=1)[:-1],
        "joint step\n[rad or m]": np.linalg.norm(np.diff(record.q, axis=0), axis=1),
        "speed\n[m/s]": np.full(79, 2 * 0.09 * np.sin(np.pi * step / 2) / step),  # chords of the circle
        "acceleration\n[m/s²]": np.full(78, 0.09 * (2 * np.sin(np.pi * step / 2) / step) ** 2),
    }
    for label, values in expected.items():
        np.testing.assert_allclose(shown[label].lines[0].get_ydata(), values, rtol=1e-9)
        assert shown[label].get_yscale() == "log"
    np.testing.assert_allclose(shown["$x$ [m]"].lines[0].get_ydata(), record.position[:, 0])
    np.testing.assert_allclose(shown["$z$ [m]"].lines[-1].get_ydata(), record.desired_position[:, 2])


@pytest.mark.slow
def test_the_same_orientation_has_one_sign_in_all_runs():
    record = run()
    pose, desired = record.pose.copy(), record.desired.copy()
    pose[10:30] *= -1
    desired[20:, :8] *= -1
    shown = panels(
        compare_criteria({"plain": record, "jumping": changed(record, pose=pose, desired=desired)})
    )
    for line in shown["orientation $w$"].lines:
        np.testing.assert_allclose(line.get_ydata(), 1.0)


@pytest.mark.slow
def test_many_runs_differ_and_the_desired_pose_is_that_of_the_longest():
    records = {f"gain {i}": run(lag=0.001 * (i + 1)) for i in range(8)}
    short = records["gain 0"]
    records["gain 0"] = Record(
        *(getattr(short, name)[:5] for name in ("time", "q", "measured", "command", "pose", "desired")),
        short.joint_names,
    )
    figure = compare_criteria(records)
    for axes in drawn(figure):
        looks = {
            (line.get_color(), line.get_linestyle()) for line in axes.lines if line.get_label() in records
        }
        assert len(looks) == 8
    assert len(panels(figure)["$y$ [m]"].lines[-1].get_ydata()) == 60
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.width
    assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes)


@pytest.mark.slow
def test_a_resting_and_a_diverged_run_can_be_compared():
    resting = changed(run(), pose=np.repeat(shifted([[0.5, 0, 0.4]]), 60, axis=0), q=np.zeros((60, 3)))
    pose, q = run().pose.copy(), run().q.copy()
    pose[40:], q[41:] = np.nan, np.inf
    drawn(compare_criteria({"resting": resting, "diverged": changed(run(), pose=pose, q=q)}))


@pytest.mark.slow
def test_peaks_stay_in_sight_above_exact_zeros():
    command = np.zeros((60, 3))
    command[3] = 1.0
    low, high = panels(compare_criteria({"one": changed(run(), command=command)}))[
        "control\n[rad/s or m/s]"
    ].get_ylim()
    assert low > 1e-6
    assert high > np.sqrt(3)


def test_no_run_is_refused():
    with pytest.raises(ShapeError, match="records: expected at least one run"):
        compare_criteria({})


@pytest.mark.slow
def test_runs_in_columns_have_rows_to_one_scale():
    record = run()
    figure = criteria_side_by_side({"20 %": record, "100 %": changed(record, command=2 * record.command)})
    left, right = np.array(drawn(figure)).reshape(7, 2).T
    assert [axes.get_title() for axes in (left[0], right[0])] == ["20 %", "100 %"]
    assert [axes.get_ylim() for axes in left] == [axes.get_ylim() for axes in right]
    ours, wanted = (left[0].lines[i].get_ydata() for i in (0, 1))
    np.testing.assert_array_equal(ours, record.position[:, 0])
    np.testing.assert_array_equal(wanted, record.desired_position[:, 0])
    with pytest.raises(ShapeError, match="at least one run"):
        criteria_side_by_side({})
