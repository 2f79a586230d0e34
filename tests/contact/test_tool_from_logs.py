"""Tools told from logs, tared, and named by specs: one tool for contact and supervisor."""

import subprocess
import sys

import numpy as np
import pytest
from msgspec.structs import replace

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import ForceSensor, Tool, load_tool
from dqcontrol.errors import Error
from dqcontrol.experiments import check
from dqcontrol.experiments.spec import as_spec, read_data
from dqcontrol.logs import tool_from_logs, tool_motion
from dqcontrol.recording import save_record

ARM, START = dqc.load_robot("iiwa7"), [0, 0.6, 0, -1.6, 0, 0.9, 0]
SENSOR = ForceSensor(position=(0.0, 0.0, 0.03), rpy=(0.1, -0.4, 0.7))
TOOL = Tool(
    mass=0.8, center=(0.01, -0.02, 0.06), force_bias=(0.4, -0.2, 0.7), torque_bias=(0.02, 0.01, -0.03)
)
SEED = 20261127


def wrench_at(q, tool=TOOL, sensor=SENSOR):
    """Return what the sensor shows at configurations (N, n), of weight and bias."""
    turned = algebra.matrix_from_pose(algebra.multiply(ARM.fkm(q), algebra.pose(
        algebra.rotation_from_rpy(sensor.rpy), sensor.position)))[:, :3, :3]  # fmt: skip
    weight = tool.mass * np.einsum("nji,j->ni", turned, [0.0, 0.0, -9.81])
    bias = np.concatenate([tool.force_bias, tool.torque_bias])
    return np.hstack([weight, np.cross(tool.center, weight)]) + bias


def table(path, q, wrench, period=0.008, names="fx,fy [N],fz,tx,ty,tz [N·m]"):
    rows = np.column_stack([period * np.arange(len(q)), q, wrench])
    head = ",".join(["time", *(f"q{i + 1}" for i in range(7)), names])
    np.savetxt(path, rows, "%.9g", ",", header=head, comments="")
    return path


@pytest.fixture(scope="module")
def motion():
    return tool_motion(ARM, START, SENSOR)


@pytest.fixture(scope="module")
def log(motion, tmp_path_factory):
    rng = np.random.default_rng(SEED)
    noise = rng.standard_normal((len(motion.q), 6)) * np.repeat([0.5, 0.02], 3)
    q = motion.q + 1e-4 * rng.standard_normal(motion.q.shape)
    return table(tmp_path_factory.mktemp("log") / "log.csv", q, wrench_at(motion.q) + noise)


def test_the_motion_turns_each_axis_of_the_sensor_up_and_down(motion):
    turned = algebra.matrix_from_pose(algebra.multiply(ARM.fkm(motion.rests), algebra.pose(
        algebra.rotation_from_rpy(SENSOR.rpy), SENSOR.position)))[:, :3, :3]  # fmt: skip
    downs = sorted(np.round(-turned[:, 2], 5).tolist())
    np.testing.assert_allclose(downs, sorted((np.vstack([np.eye(3), -np.eye(3)])).tolist()), atol=1e-4)
    assert motion.condition < 1.3
    limits = ARM.limits
    assert (motion.q > limits.lower).all()
    assert (motion.q < limits.upper).all()
    assert np.abs(np.diff(motion.q, axis=0)).max() <= 0.5 * 0.008 * (1 + 1e-6)
    place = algebra.translation(ARM.fkm(motion.rests))
    np.testing.assert_allclose(place, np.tile(algebra.translation(ARM.fkm(START)), (6, 1)), atol=1e-5)


def test_what_is_left_of_a_tool_from_a_log(log):
    """At most 0.05 N and 0.005 N·m in new poses, from rests of a second with 0.5 N and 0.02 N·m noise."""
    found = tool_from_logs(log, "iiwa7", SENSOR)
    assert found.rests == 7
    q = np.random.default_rng(SEED + 1).uniform(0.9 * ARM.limits.lower, 0.9 * ARM.limits.upper, (200, 7))
    left = wrench_at(q) - wrench_at(q, found.found.tool)
    assert np.sqrt(np.mean(np.sum(left[:, :3] ** 2, axis=1))) < 0.05
    assert np.sqrt(np.mean(np.sum(left[:, 3:] ** 2, axis=1))) < 0.005
    assert found.found.force_condition < 1.3


def test_a_tare_keeps_mass_and_centre_and_finds_a_bias_that_has_drifted(tmp_path):
    drifted = replace(TOOL, force_bias=(0.1, 0.5, -0.3), torque_bias=(0.0, 0.04, 0.01))
    q = np.tile(START, (200, 1)).astype(float)
    path = table(tmp_path / "air.csv", q, wrench_at(q, drifted))
    found = tool_from_logs(path, ARM, SENSOR, known=TOOL).found.tool
    assert (found.mass, found.center) == (TOOL.mass, TOOL.center)
    np.testing.assert_allclose(found.force_bias, drifted.force_bias, atol=1e-6)
    np.testing.assert_allclose(found.torque_bias, drifted.torque_bias, atol=1e-6)
    assert found.tared is not None
    with pytest.raises(Error, match=r"too much alike"):
        tool_from_logs(path, ARM, SENSOR)


def test_a_run_on_servos_is_a_log(motion, tmp_path):
    motion.save(tmp_path / "motion")
    run = dqc.run(tmp_path / "motion/tool.yaml")
    assert not run.verdict.failure
    found = tool_from_logs(save_record(run.record, tmp_path / "record.mcap"), ARM)
    assert found.found.tool.mass == pytest.approx(0.5, abs=0.005)


@pytest.mark.parametrize(
    ("content", "words"),
    [("time,q1,q2,q3,q4,q5,q6,q7\n0,0,0,0,0,0,0,0\n1,0,0,0,0,0,0,0\n", "holds no wrench")],
)
def test_logs_that_say_nothing_of_a_tool(tmp_path, content, words):
    path = tmp_path / "log.csv"
    path.write_text(content)
    with pytest.raises(Error, match=words):
        tool_from_logs(path, ARM)


def test_a_robot_that_never_rests(motion, tmp_path):
    q = np.linspace(0, 1, 300)[:, None] * np.ones(7)
    with pytest.raises(Error, match=r"nowhere rests for 0\.7 s"):
        tool_from_logs(table(tmp_path / "log.csv", q, wrench_at(q)), ARM)


def test_specs_name_a_tool_file_for_contact_and_supervisor(log, tmp_path):
    found = tool_from_logs(log, ARM, SENSOR)
    file = found.save(tmp_path / "pen.yaml")
    tool = load_tool(file)
    assert tool.mass == pytest.approx(found.found.tool.mass, abs=1e-8)
    spec = tmp_path / "press.yaml"
    spec.write_text(
        f"""
name: press
robot: iiwa7
start: {START}
period: 4 ms
reference: {{kind: set-point, duration: 2 s}}
law: {{kind: proportional-feedforward, gain: 1}}
contact:
  axes: base
  force: {{z: 2 N}}
  translation: {{damping: 200, stiffness: [rigid, rigid, 0]}}
  sensor: {{tool: pen.yaml, tare: 0.5 s}}
supervisor: {{payload: pen.yaml, contact_force: 20}}
world: {{board: {{box: [0.6, 0.6, 0.04], position: [0.55, 0, 0.28], stiffness: 2000}}}}
plant: {{kind: servo, time_constant: 40 ms, delay: 12 ms, wrist: {{}}}}
"""
    )
    loaded = as_spec(*read_data(spec))
    assert loaded.contact.sensor.tool == tool
    assert loaded.supervisor.payload == tool
    text = " ".join(str(check(spec)).split())
    assert "bias measured today" in text
    assert "bias measured at the start, at rest in the air" in text
    spec.write_text(spec.read_text().replace("pen.yaml", "pan.yaml"))
    with pytest.raises(Error, match=r"pan\.yaml"):
        check(spec)


@pytest.mark.slow
def test_the_command_line_proposes_and_identifies(log, tmp_path):
    def run(*words):
        done = subprocess.run(
            [sys.executable, "-m", "dqcontrol", *words], capture_output=True, text=True, check=False, cwd=tmp_path
        )  # fmt: skip
        return done.returncode, done.stdout, done.stderr

    position, turn = "0,0,0.03", "0.1,-0.4,0.7"
    code, out, error = run(
        "identify", "tool", str(log), "--robot", "iiwa7", "--sensor-position", position, "--sensor-rpy", turn,
        "--out", "pen.yaml",
    )  # fmt: skip
    assert code == 0, error
    assert "tool from 7 rests" in out
    assert load_tool(tmp_path / "pen.yaml").mass == pytest.approx(0.8, abs=0.01)
    code, _, error = run("identify", "tool", str(log), "--robot", "little-john")
    assert code == 2
    assert "Traceback" not in error
