import subprocess
import sys
from typing import Any

import matplotlib
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ExistsError, ShapeError, UnknownNameError
from dqcontrol.figures.comparisons import compare_errors
from dqcontrol.figures.paths import compare_paths, path_3d
from dqcontrol.figures.plots import control_signals, errors, joint_angles, pose_coefficients
from dqcontrol.figures.save import run_figures, save_figures
from dqcontrol.loop.record import Record
from dqcontrol.robots.limits import Limits, symmetric_limits


def shifted(points):
    points = np.asarray(points, float)
    return np.hstack([np.tile([1.0, 0, 0, 0, 0], (len(points), 1)), points / 2])


def run(count=60, lag=0.01, plane=((1, 0, 0), (0, 0, 1)), joints=3):
    """A hand that follows a circle in a plane at a distance."""
    time = np.linspace(0, 2, count)
    first, second = np.asarray(plane, float)
    circle = 0.1 * (np.cos(np.pi * time)[:, None] * first + np.sin(np.pi * time)[:, None] * second)
    centre = np.array([0.5, 0, 0.4])
    desired = np.hstack([shifted(centre + circle), np.zeros((count, 13))])
    q = np.sin(time)[:, None] * np.linspace(1, joints, joints)
    pose = shifted(centre + circle * (1 - lag / 0.1))
    return Record(
        time, q, q, np.gradient(q, axis=0), pose, desired, tuple(f"joint_{i}" for i in range(joints))
    )


def drawn(figure) -> list[Any]:
    """Draw a figure with every warning an error, and return its visible axes."""
    figure.savefig(_Sink(), format="png")
    return [axes for axes in figure.axes if axes.get_visible()]


class _Sink:
    def write(self, data):
        return len(data)

    def flush(self):
        pass


pytestmark = pytest.mark.filterwarnings("error")


def test_errors_hold_the_numbers_of_the_record_in_mm_and_degrees():
    record = run()
    norm, position, orientation = drawn(errors(record))
    assert norm.get_yscale() == "log"
    np.testing.assert_allclose(norm.lines[0].get_ydata(), 0.005)
    np.testing.assert_allclose(position.lines[0].get_ydata(), 10.0)
    np.testing.assert_allclose(orientation.lines[0].get_ydata(), 0.0)
    assert [axes.get_ylabel() for axes in (position, orientation)] == ["position [mm]", "orientation [°]"]


def test_an_error_of_exactly_zero_can_be_drawn():
    drawn(errors(run(lag=0.0)))


@pytest.mark.slow
def test_comparisons_name_every_run_and_look_different():
    labels = [f"gain {i}" for i in range(16)]
    records = {label: run(lag=0.001 * (i + 1)) for i, label in enumerate(labels)}
    for figure in (compare_errors(records), compare_paths(records)):
        axes = drawn(figure)[0]
        looks = {
            (line.get_color(), line.get_linestyle()) for line in axes.lines if line.get_label() in labels
        }
        assert len(looks) == len(labels)
        (legend,) = figure.legends
        assert set(labels) <= {text.get_text() for text in legend.get_texts()}
    for compare in (compare_errors, compare_paths):
        with pytest.raises(ShapeError, match="records: expected at least one run"):
            compare({})


@pytest.mark.slow
def test_pose_does_not_jump_between_signs():
    record = run()
    pose = record.pose.copy()
    pose[20:40] *= -1
    figure = pose_coefficients(
        Record(record.time, record.q, record.q, record.q, pose, record.desired, record.joint_names)
    )
    axes = drawn(figure)
    assert len(axes) == 8
    for panel in axes:
        hand, desired = (line.get_ydata() for line in panel.lines)
        np.testing.assert_allclose(hand, desired, atol=0.01)


def test_joint_angles_are_in_degrees_with_the_limits_that_are_near():
    record = run(joints=3)
    lower, upper = np.radians([-172, -172]), np.radians([60, 120])
    limits = Limits(np.append(lower, -90), np.append(upper, 90), np.ones(3), np.ones(3))
    figure = joint_angles(record, limits, ["rad", "rad", "m"])
    first, third, second, _ = drawn(figure)  # panels fill the columns downwards
    np.testing.assert_allclose(first.lines[0].get_ydata(), np.degrees(record.q[:, 0]))
    np.testing.assert_allclose(third.lines[0].get_ydata(), record.q[:, 2])
    bounds = [[round(line.get_ydata()[0]) for line in panel.lines[1:]] for panel in (first, second, third)]
    assert bounds == [[60], [120], []]
    assert [panel.get_title(loc="left") for panel in (first, third)] == [
        "joint_0   (−172 … 60 °)",
        "joint_2   (−90 … 90 m)",
    ]
    assert -60 < first.get_ylim()[0] < 0
    assert first.get_ylim()[1] > 60


def test_joints_without_limits_show_infinity_and_an_arm_of_one_joint_fits():
    limits = symmetric_limits([np.pi], [1], [1])
    one = run(joints=1)
    assert "(−180 … 180 °)" in drawn(joint_angles(one, limits))[0].get_title(loc="left")
    assert drawn(joint_angles(one, Limits.none(1)))[0].get_title(loc="left").endswith("(−∞ … ∞ °)")


@pytest.mark.slow
def test_inputs_of_each_unit_have_a_panel_and_are_held():
    record = run(joints=3)
    metres, radians, norm = (
        drawn(control_signals(record, ["m", "rad", "rad"]))[1::-1] + drawn(control_signals(record))[-1:]
    )
    assert (metres.get_ylabel(), len(metres.lines)) == ("input [m/s]", 1)
    assert (radians.get_ylabel(), len(radians.lines)) == ("input [rad/s]", 2)
    assert radians.lines[0].get_drawstyle() == "steps-post"
    np.testing.assert_allclose(norm.lines[0].get_ydata(), np.linalg.norm(record.command, axis=1))


@pytest.mark.parametrize(
    ("plane", "labels"),
    [
        (((1, 0, 0), (0, 0, 1)), ("x [m]", "z [m]")),
        (((1, 0, 0), (0, 1, 0)), ("x [m]", "y [m]")),
        (((0, 1, 0), (0, 0, 1)), ("y [m]", "z [m]")),
        (((0.6, 0.8, 0), (0, 0, 1)), ("horizontal in the plane [m]", "upwards in the plane [m]")),
    ],
)
def test_planar_paths_have_a_front_view_without_foreshortening(plane, labels):
    space, front = drawn(path_3d(run(plane=plane, lag=0.0)))
    assert (front.get_xlabel(), front.get_ylabel()) == labels
    x, y = front.lines[0].get_data()
    np.testing.assert_allclose(
        np.hypot(x - (x.max() + x.min()) / 2, y - (y.max() + y.min()) / 2), 0.1, atol=1e-3
    )
    box = front.get_window_extent()
    scale = box.width / np.ptp(front.get_xlim()), box.height / np.ptp(front.get_ylim())
    assert scale[0] == pytest.approx(scale[1], rel=1e-6)
    assert len(space.lines[0].get_data_3d()) == 3


def test_one_scale_on_all_axes_in_space():
    (space,) = drawn(path_3d(spiral()))
    size = np.array([np.ptp(space.get_xlim()), np.ptp(space.get_ylim()), np.ptp(space.get_zlim())])
    aspect = np.asarray(space._box_aspect)
    np.testing.assert_allclose(size / aspect, size[0] / aspect[0])


def spiral():
    record = run()
    points = record.desired_position + np.linspace(0, 0.1, len(record))[:, None] * [0, 1, 0]
    desired = np.hstack([shifted(points), np.zeros((len(record), 13))])
    return Record(record.time, record.q, record.q, record.q, shifted(points), desired, record.joint_names)


@pytest.mark.slow
def test_a_resting_target_is_a_mark_and_a_resting_hand_can_be_drawn():
    still = np.tile([1.0, 0, 0, 0, 0, 0.1, 0, 0], (3, 1))
    q = np.zeros((3, 1))
    record = Record(np.arange(3.0), q, q, q, still, np.hstack([still, np.zeros((3, 13))]), ("a",))
    figure = path_3d(record)
    drawn(figure)
    assert "target" in [text.get_text() for text in figure.legends[0].get_texts()]
    for function in (errors, pose_coefficients, joint_angles, control_signals):
        drawn(function(record))


@pytest.mark.slow
def test_a_diverged_run_can_be_drawn():
    record = run()
    pose, q, command = record.pose.copy(), record.q.copy(), record.command.copy()
    pose[50:], q[50:], command[50:] = np.nan, np.inf, np.inf
    broken = Record(
        record.time, q, q, command, pose, record.desired, record.joint_names, stopped="diverged: q"
    )
    for function in (path_3d, errors, pose_coefficients, joint_angles, control_signals):
        drawn(function(broken))


def open_figures():
    pyplot = sys.modules.get("matplotlib.pyplot")
    return pyplot.get_fignums() if pyplot else []


def test_figures_ignore_and_keep_the_users_settings():
    before = open_figures()
    with matplotlib.rc_context({"lines.linewidth": 9.0, "font.size": 30}):
        figure = errors(run())
        assert figure.axes[0].lines[0].get_linewidth() == 1.4
        assert matplotlib.rcParams["lines.linewidth"] == 9.0
    assert open_figures() == before


@pytest.mark.slow
def test_every_figure_of_a_run_is_written_once_and_twice_the_same(tmp_path):
    spec = {
        "name": "circle",
        "robot": "iiwa7",
        "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
        "period": 0.01,
        "reference": {"kind": "circle", "radius": 0.02, "duration": 2, "ramp": 0.5},
        "law": {"kind": "proportional-feedforward", "gain": 5.0},
        "plant": {"kind": "integrator"},
    }

    def write(folder):
        figures = {name: draw() for name, draw in run_figures(dqc.run(spec)).items()}
        return save_figures(figures, folder, ["png", "svg"])

    first = write(tmp_path / "a")
    assert [path.name for path in first[::2]] == [
        "path.png",
        "errors.png",
        "pose.png",
        "joints.png",
        "margins.png",
        "inputs.png",
    ]
    assert first[0].read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    second = write(tmp_path / "b")
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_figures_overwrite_nothing(tmp_path):
    (tmp_path / "joints.png").write_text("precious")
    with pytest.raises(ExistsError, match=r"joints\.png: exists already"):
        save_figures({"errors": errors(run()), "joints": joint_angles(run())}, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["joints.png"]


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (lambda r: joint_angles(r, symmetric_limits([1], [1], [1])), ShapeError, "limits: expected 3"),
        (lambda r: joint_angles(r, units=["rad"]), ShapeError, "units: expected 3 units, got 1"),
        (lambda r: control_signals(r, ["rad", "rad", "deg"]), UnknownNameError, "units: unknown name 'deg'"),
        (
            lambda r: save_figures({"errors": errors(r)}, "nowhere", ["pgn"]),
            UnknownNameError,
            "'pgn'; did you mean 'png'",
        ),
    ],
)
def test_bad_options(call, kind, message):
    with pytest.raises(kind, match=message):
        call(run())


def loaded(code, *modules):
    """Return which of these modules a program loads."""
    code += f"\nimport sys; print(sorted({set(modules)} & set(sys.modules)))"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_commands_load_only_what_they_need():
    """Each of these takes as long to load as all of ours."""
    names = ("figures", "recording.mcap", "experiments", "cli.experiment_commands")
    code = "import " + ", ".join(f"dqcontrol.{name}" for name in names)
    heavy = ("matplotlib", "mcap", "joblib", "mujoco", "scipy.signal", "scipy.linalg", "scipy.optimize")
    assert loaded(code, *heavy).strip() == "[]"


@pytest.mark.slow
def test_a_styled_figure_does_without_pyplot_and_is_drawn_once_a_format():
    code = """
from dqcontrol.figures.save import encoded
from dqcontrol.figures.style import new_figure, styled
figure = styled(lambda: new_figure(3, 2))()
draw, drawn = figure.draw, []
figure.draw = lambda renderer: drawn.append(draw(renderer))
encoded(figure, "png")
assert len(drawn) == 1, drawn
"""
    assert loaded(code, "matplotlib.pyplot").strip() == "[]"
