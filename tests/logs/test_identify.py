"""What logs tell of servos, against a simulator that shares no code with the package."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo_simulator import GRID, answer, encoder, lagged, multisine, played, second_order_answer, write_log

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, ValueRangeError
from dqcontrol.logs.servos.joint_fit import resolution_of, sandwich
from dqcontrol.logs.servos.joint_gates import JointIdentification, identify_joint
from dqcontrol.logs.servos.replay import CommandedLog
from dqcontrol.logs.servos.servo_orders import FIRST_ORDER, SECOND_ORDER, held, joined
from dqcontrol.plants import Servo, load_servo
from dqcontrol.robots import Inertia, SerialArm

SEED = 20261122


def arm_of(n):
    return SerialArm.from_dh([0] * n, [0.1] * n, [0.2] * n, [0] * n, name="bench")


def stamps_of(rng, seconds, period, jitter=0.2):
    count = round(seconds / period)
    return np.arange(count) * period + rng.uniform(-0.5, 0.5, count) * jitter * period


def test_the_response_is_that_of_the_simulator_and_its_slopes_are_right():
    rng = np.random.default_rng(SEED)
    edges, times = np.cumsum(rng.uniform(0.005, 0.02, 200)), np.sort(rng.uniform(0.1, 2.5, 400))
    values = rng.normal(size=200)
    target = held(edges, values)
    numbers = np.array([0.043, 0.0137])
    got = FIRST_ORDER.answer(target, numbers, times)
    truth = answer(edges, values, 0.043, 0.0137, times)
    begins = (truth[0] - got.output[0]) * np.exp(-(times - times[0]) / 0.043)  # it begins on its target
    np.testing.assert_allclose(got.output + begins, truth, atol=1e-12)
    smooth = joined(edges, np.sin(3 * edges))
    for signal in (target, smooth):
        step, late = 1e-7, times > 0.5
        got = FIRST_ORDER.answer(signal, numbers, times)
        by_lag, by_delay = (
            (FIRST_ORDER.answer(signal, numbers + step * unit, times).output - got.output) / step
            for unit in np.eye(2)
        )
        np.testing.assert_allclose(got.slopes[late, 0], by_lag[late], atol=2e-3)
        near = np.abs(times[:, None] - edges - 0.0137).min(axis=1) > 1e-6
        np.testing.assert_allclose(got.slopes[late & near, 1], by_delay[late & near], atol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.4, 1.0, 1.7])
def test_the_response_of_second_order_is_that_of_the_simulator(damping):
    rng = np.random.default_rng(SEED)
    edges, times = np.cumsum(rng.uniform(0.005, 0.02, 100)), np.sort(rng.uniform(0.05, 1.2, 100))
    values = rng.normal(size=100)
    values[:5] = values[0]  # at rest where both begin
    numbers = np.array([25.0, damping, 0.0137])
    got = SECOND_ORDER.answer(held(edges, values), numbers, times)
    truth = second_order_answer(edges, values, 25.0, damping, 0.0137, times)
    late = times > 0.8
    np.testing.assert_allclose(got.output[late], truth[late], atol=1e-5)
    target, step = held(edges, values), 1e-6
    for column, size in enumerate((25 * step, step, step)):
        moved = size * np.eye(3)[column]
        ends = [SECOND_ORDER.answer(target, numbers + sign * moved, times).output for sign in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * size)
        near = np.abs(times[:, None] - edges - 0.0137).min(axis=1) < 1e-5
        np.testing.assert_allclose(
            got.slopes[late & ~near, column], slope[late & ~near], atol=1e-4, rtol=1e-4
        )


def test_intervals_by_windows_are_those_of_the_weighted_sum():
    rng = np.random.default_rng(SEED)
    jacobian, residual = rng.normal(size=(400, 3)).cumsum(axis=0), np.zeros(400)
    for k in range(1, 400):
        residual[k] = 0.8 * residual[k - 1] + rng.normal()
    along = float(residual[1:] @ residual[:-1]) / float(residual @ residual)
    ratio = 4 * along**2 / ((1 - along) ** 2 * (1 + along) ** 2)
    width, pulled = int(np.ceil(1.1447 * (ratio * 400) ** (1 / 3))), jacobian * residual[:, None]
    middle = pulled.T @ pulled
    for late in range(1, width + 1):
        part = pulled[:-late].T @ pulled[late:]
        middle += (1 - late / (width + 1)) * (part + part.T)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(
        sandwich(jacobian, residual), inverse @ middle @ inverse * 400 / 397, rtol=1e-9
    )


def identified(targets, positions, time):
    log = CommandedLog(Path("log"), time, positions[:, None], time, targets[:, None], True)
    return identify_joint("joint", "rad", log.segments(0, "positions", None), log.period)


def test_a_log_without_noise_is_identified():
    """Its joint stands still for most of the time, so that its noise is 0 and not only small."""
    time = np.arange(2000) * 0.008
    targets = np.where(time < 5, multisine(np.random.default_rng(SEED), time), 0.0)
    positions = answer(time, targets, 0.05, 0.012, time)
    positions[time > 6] = 0.0
    found = identified(targets, positions, time)
    assert found.floor > 0
    assert found.status == "fitted"


@pytest.mark.parametrize(
    ("bandwidth", "damping", "delay", "step"), [(30.0, 0.7, 0.012, 0.0), (40.0, 0.8, 0.005, 1.5e-3)]
)
def test_second_order_is_found_where_the_data_ask_for_it(bandwidth, damping, delay, step):
    rng = np.random.default_rng(SEED)
    time = np.arange(2500) * 0.008
    target = multisine(rng, time)
    true = second_order_answer(time, target, bandwidth, damping, delay, time)
    found = identified(target, encoder(rng, true, step, 5e-5), time)
    assert found.order == 2
    assert found.bandwidth == pytest.approx(bandwidth, rel=0.03)
    assert found.damping_ratio == pytest.approx(damping, rel=0.03)
    assert found.delay == pytest.approx(delay, abs=0.25 * 0.008)
    assert found.lag == pytest.approx(2 * damping / bandwidth, rel=0.03)
    assert found.bandwidth_interval[0] < bandwidth < found.bandwidth_interval[1]
    assert found.residual < 1.2 * found.floor


@pytest.mark.parametrize(
    ("play", "step"),
    [
        (0.0, 0.0),
        (1e-3, 4e-4),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in ((1e-3, 0.0), (3e-3, 4e-4), (3e-3, 1.5e-3), (1e-2, 0.0))
        ),
    ],
)
def test_play_is_indicated_and_does_not_change_the_lag(play, step):
    rng = np.random.default_rng(SEED)
    time = np.arange(2500) * 0.008
    target = multisine(rng, time)
    true = played(answer(time, target, 0.05, 0.017, time), play / 2)
    found = identified(target, encoder(rng, true, step, 1e-4), time)
    assert found.friction == pytest.approx(play / 2, rel=0.1)
    assert found.order == 1
    assert found.lag == pytest.approx(0.05, rel=0.01)
    assert found.delay == pytest.approx(0.017, abs=0.0005)
    assert ("play" in " ".join(found.notes)) == (play > 0)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Return the identification of six joints: fine, coarse, idle, clamped, ambiguous, stuck; and what is true."""
    rng = np.random.default_rng(SEED)
    time = stamps_of(rng, 20.0, 0.008)
    count = len(time)
    lags, delays = [0.061, 0.032, 0.05, 0.05, 0.05, 0.05], [0.0137, 0.027, 0.02, 0.02, 0.02, 0.02]
    targets = np.column_stack([multisine(rng, time) for _ in range(6)])
    targets[:, 2] = 0.3
    targets[:, 4] = 0.01 * np.sin(0.6 * time)
    true = np.column_stack([answer(time, targets[:, i], lags[i], delays[i], time) for i in range(6)])
    true[:, 0] *= 1.01
    true[:, 3] = answer(time, np.minimum(targets[:, 3], 0.5 * targets[:, 3].max()), 0.05, 0.02, time)
    true[:, 5] = 0.0
    resolutions = [0.0, 1.5e-3, 0.0, 0.0, 0.0, 0.0]
    noises = [2e-4, 5e-5, 2e-4, 2e-4, 4e-4, 2e-4]
    seen = np.column_stack([encoder(rng, true[:, i], resolutions[i], noises[i]) for i in range(6)])
    kept = np.sort(rng.permutation(count)[: round(0.97 * count)])
    folder = tmp_path_factory.mktemp("bench")
    path = write_log(folder / "log.csv", time[kept], targets[kept], seen[kept])
    return dqc.identify(path, arm_of(6)), lags, delays, folder


def test_good_joints_are_found_and_others_refused_with_the_reason(bench):
    found, lags, delays, _ = bench
    assert [joint.status for joint in found.joints] == ["fitted", "fitted", *["refused"] * 4], str(found)
    for joint, lag, delay in zip(found.joints, lags[:2], delays, strict=False):
        assert joint.lag == pytest.approx(lag, rel=0.02)
        assert joint.delay == pytest.approx(delay, abs=0.25 * 0.008)
        assert joint.lag_interval[0] < lag < joint.lag_interval[1]
        assert joint.delay_interval[0] < delay < joint.delay_interval[1]
        assert joint.residual < 1.2 * joint.floor
        assert joint.correlation < -0.5
    first, second = found.joints[:2]
    assert first.gain == pytest.approx(1.01, abs=1e-3)
    assert first.noise == pytest.approx(2e-4, rel=0.2)
    assert (first.resolution, second.resolution) == (0.0, pytest.approx(1.5e-3, rel=1e-3))
    reasons = [joint.reason.split(":")[0] for joint in found.joints[2:]]
    assert reasons == ["idle", "clamped", "ambiguous", "stuck"], str(found)


def test_the_files_hold_what_others_rely_on(bench):
    found, _, _, folder = bench
    out = found.save(folder / "out")
    data = json.loads((out / "identification.json").read_text(encoding="utf-8"))
    wanted = {"name", "status", "reason", "lag", "lag_interval", "delay", "delay_interval", "gain", "sag"}
    wanted |= {"resolution", "noise"}
    assert all(wanted <= set(joint) for joint in data["joints"])
    assert data["joints"][0]["lag"] == found.joints[0].lag
    assert len(data["joints"][0]["delay_interval"]) == 2
    assert data["joints"][2]["lag"] is None
    servo = load_servo(out / "plant.yaml")
    assert servo == found.plant()
    assert isinstance(servo.time_constant, list)
    assert servo.time_constant[2] == pytest.approx(np.mean(servo.time_constant[:2]))
    text = (out / "plant.yaml").read_text(encoding="utf-8")
    assert "assumed: [joint_3, joint_4, joint_5, joint_6]" in text
    assert "sha256: " in text
    (folder / "run").mkdir()
    (folder / "run" / "record.mcap").write_bytes(b"1")
    recorded = replace(found, logs=(folder / "run",)).plant_text()
    assert "record.mcap" in recorded
    assert "6b86b273ff34fce19d6b804eff5a3f5747ada4eaa22f1d49c01e52ddb7875b4b" in recorded  # of "1"
    with pytest.raises(FileExistsError, match="out: exists"):
        found.save(out)
    found.save(out, force=True)


def test_the_plant_file_is_a_plant_of_specs(bench):
    found, _, _, folder = bench
    found.save(folder / "spec", force=True)
    arm = arm_of(6)
    spec = {
        "name": "replay",
        "robot": arm,
        "start": [0, 0.3, 0.3, 0.3, 0.3, 0.3],
        "period": 0.008,
        "reference": {"kind": "set-point", "duration": 1},
        "law": {"kind": "proportional", "gain": 3},
        "plant": {"kind": "servo", "file": str(folder / "spec" / "plant.yaml"), "encoder_noise": 0.0},
    }
    from dqcontrol.experiments.spec import read_spec

    plant = read_spec(spec)[0].plant
    assert isinstance(plant, Servo)
    assert plant.delay == found.plant().delay
    assert plant.encoder_noise == 0  # what the spec says itself counts
    (folder / "other.yaml").write_text("robot: iiwa7\n")
    for name, message in [("none.yaml", r"none\.yaml: no such file"), ("other.yaml", "is no plant file")]:
        with pytest.raises(FileFormatError, match=message):
            read_spec(spec | {"plant": {"kind": "servo", "file": str(folder / name)}})


@pytest.mark.slow
def test_commanded_velocities_count_from_the_target_or_the_measured_position(tmp_path):
    rng = np.random.default_rng(SEED)
    time = np.arange(2000) * 0.008
    targets = multisine(rng, time)
    speeds = np.append(np.diff(targets), 0.0) / 0.008  # each moves the target at once
    true = answer(time, np.append(targets[1:], targets[-1]), 0.05, 0.0125, time)
    seen = encoder(rng, true, 0.0, 1e-4)[:, None]
    found = dqc.identify(write_log(tmp_path / "log.csv", time, speeds[:, None], seen, what="u"), arm_of(1))
    assert found.mode == "integrated"
    assert found.joints[0].lag == pytest.approx(0.05, rel=0.02)
    assert found.joints[0].delay == pytest.approx(0.0125, abs=0.002)
    q, wanted = np.zeros(len(time)), np.zeros(len(time))
    for k in range(1, len(time)):  # targets count from the measured position; the delay is one period
        wanted[k - 1] = q[k - 1] + 1e-4 * rng.normal() + 0.008 * 6.75 * speeds[k - 1]
        q[k] = q[k - 1] + (1 - np.exp(-0.008 / 0.05)) * (wanted[max(k - 2, 0)] - q[k - 1])
    seen = encoder(rng, q, 0.0, 1e-5)[:, None]
    path = write_log(tmp_path / "log.csv", time, 6.75 * speeds[:, None], seen, what="u")
    found = dqc.identify(path, arm_of(1))
    assert found.mode == "measured"
    assert found.plant().command_mode == "measured"


@pytest.mark.slow
def test_sag_is_found_beside_lag_and_delay(tmp_path):
    """Two links of 1 m and 1 kg in a vertical plane: their torques are written out here."""
    rng = np.random.default_rng(SEED)
    upright, ahead = [0.5**0.5, 0.5**0.5, 0, 0, 0, 0, 0], [1, 0, 0, 0, 1, 0, 0]
    masses = Inertia(np.ones(2), np.array([[0.5, 0, 0]] * 2), np.zeros((2, 3, 3)))
    arm = SerialArm([upright, ahead, ahead], ["revolute"] * 2, inertia=masses, name="planar")
    fine, lags, sags = np.arange(0, 20, GRID), np.array([0.05, 0.08]), np.array([2e-3, 4e-3])
    time = fine[::8]
    targets = np.column_stack([multisine(rng, time, 0.6) for _ in range(2)])
    bare = np.column_stack([answer(time, targets[:, i], lags[i], 0.0165, fine) for i in range(2)])
    q = bare
    for _ in range(4):
        elbow = 0.5 * 9.81 * np.cos(q.sum(axis=1))
        torques = 1.5 * 9.81 * np.cos(q[:, 0]) + elbow, elbow
        q = bare - np.column_stack([sags[i] * lagged(torques[i], lags[i]) for i in range(2)])
    seen = encoder(rng, q[::8], 0.0, 1e-4)
    found = dqc.identify(write_log(tmp_path / "log.csv", time, targets, seen), arm)
    for joint, lag, sag in zip(found.joints, lags, sags, strict=True):
        assert joint.sag == pytest.approx(sag, rel=0.05)
        assert joint.lag == pytest.approx(lag, rel=0.02)
        assert joint.delay == pytest.approx(0.0165, abs=0.002)
    np.testing.assert_allclose(1 / np.array(found.plant().stiffness), sags, rtol=0.05)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (["time", "q1"], r"log\.csv: holds no commands of the joints: columns target_JOINT, r1"),
        (["time", "q1", "same"], r"log\.csv: joint_1: the commanded positions are a copy of the measured"),
        (["time", "q1", "still"], r"log\.csv: no command ever changes"),
        (
            ["time", "q1", "q2", "moved"],
            r"log\.csv:1: column q2: bench has 1 joints; is this another robot",
        ),
        (
            ["time", "q1", "degrees"],
            r"log\.csv: joint_1: its commands move 59\.\d times .* degrees beside rad",
        ),
        (["time", "moved"], r"log\.csv:1: joints missing: joint_1"),
        (["back", "q1", "moved"], r"log\.csv:52: time: must increase, got 0\.1 after 0\.49"),
    ],
)
def test_what_is_wrong_with_a_log_is_said_in_one_line(tmp_path, columns, message):
    time = np.arange(400) * 0.01
    table = {"time": time, "q1": np.sin(time), "moved": np.sin(time + 0.1), "same": np.sin(time)}
    table |= {"q2": np.sin(time), "degrees": np.degrees(np.sin(time + 0.1))}
    table |= {"still": np.zeros(400), "back": np.where(np.arange(400) == 50, 0.1, time)}
    names = {"same": "r1", "still": "r1", "moved": "r1", "degrees": "r1", "back": "time"}
    header = ",".join(names.get(column, column) for column in columns)
    rows = np.column_stack([table[column] for column in columns])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.10g")
    with pytest.raises(FileFormatError, match=message):
        dqc.identify(path, arm_of(1))


def test_logs_with_different_commands_and_too_short_ones_are_refused(tmp_path):
    time = np.arange(400) * 0.01
    motion = np.sin(time)[:, None]
    one = write_log(tmp_path / "one.csv", time, motion, 0.99 * motion)
    two = write_log(tmp_path / "two.csv", time, motion, 0.99 * motion, what="u")
    with pytest.raises(FileFormatError, match=r"one\.csv: holds other commands than .*two\.csv"):
        dqc.identify([one, two], arm_of(1))
    with pytest.raises(FileFormatError, match=r"one\.csv: too short or too full of gaps"):
        dqc.identify(write_log(one, time[:50], motion[:50], 0.99 * motion[:50]), arm_of(1))
    found = dqc.identify(write_log(one, time, motion, np.ones((400, 1))), arm_of(1))
    assert found.joints[0].reason.startswith("stuck")
    with pytest.raises(ValueRangeError, match="no joint could be identified, so there is no plant"):
        found.plant()


@pytest.mark.parametrize("step", [0.0, 3.8e-4, 1.5e-3])
def test_the_step_of_an_encoder_is_found(step):
    rng = np.random.default_rng(SEED)
    values = encoder(rng, multisine(rng, np.arange(3000) * 0.01), step, 5e-5)
    assert resolution_of(values) == pytest.approx(step, rel=1e-6)


def test_the_command_line_prints_the_joints_and_writes_the_files(bench, tmp_path, monkeypatch, capsys):
    _, _, _, folder = bench
    from dqcontrol.cli.log_commands import servos

    monkeypatch.setattr("dqcontrol.logs.servos.identification.load_robot", lambda *_: arm_of(6))
    servos([folder / "log.csv"], robot="bench", out=tmp_path / "out")
    printed = capsys.readouterr().out
    assert "bench: servos behind commanded positions" in printed
    assert "joint_4: clamped: targets beyond" in printed
    assert f"results: {tmp_path / 'out'}" in printed
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "identification.json",
        "plant.yaml",
        "report.html",
    }


@pytest.mark.slow
def test_two_hundred_logs():
    """Lag, delay and intervals of 200 random joints; idle, clamped and ambiguous ones among as many others."""
    from study_of_logs import study

    found = study(200, SEED)
    print(f"seed {SEED}: {found}", file=sys.stderr)
    assert found["lags within 2 %"] > 0.95
    assert found["lag error, largest"] < 0.04
    assert found["lag error, RMS"] < 0.01
    assert found["delay error, largest"] < 0.25
    assert found["left over the floor, largest"] < 1.2
    for name in ("lag", "delay"):
        assert 0.90 <= found[f"coverage of {name}"] <= 0.99
    assert found["good refused"] == 0
    assert found["bad fitted"] == 0


@pytest.mark.slow
def test_a_slow_circle_tells_only_the_sum_of_lag_and_delay(tmp_path):
    """Targets that follow the measurement explain it almost as well, with lags of zero: they are not believed."""
    spec = {
        "name": "slow",
        "robot": "iiwa7",
        "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
        "period": 0.01,
        "reference": {"kind": "circle", "radius": 0.07, "duration": 20},
        "law": {"kind": "proportional-feedforward", "gain": 5},
        "plant": {"kind": "servo", "time_constant": 0.06, "delay": 0.016},
    }
    dqc.run(spec).save(tmp_path / "run", figures=False)
    found = dqc.identify(tmp_path / "run" / "record.mcap", "iiwa7")
    reasons = [joint.reason for joint in found.joints if not joint.reason.startswith("idle")]
    sums = [float(each) for each in re.findall(r"ambiguous: .* sure, (\S+) ms", "\n".join(reasons))]
    assert len(sums) == 3
    assert sums == pytest.approx(3 * [76], abs=1)


def test_a_table_without_column_names_and_a_file_of_another_robot_are_said(tmp_path):
    time = np.arange(400) * 0.01
    motion = np.sin(time)[:, None]
    path = write_log(tmp_path / "one.csv", time, motion, 0.99 * motion)
    two = write_log(tmp_path / "two.csv", time, np.hstack([motion] * 2), 0.99 * np.hstack([motion] * 2))
    with pytest.raises(FileFormatError, match=r"two\.csv:1: column q2: bench has 1 joints"):
        dqc.identify([path, two], arm_of(1))
    path.write_text("\n".join(path.read_text().splitlines()[1:]))
    with pytest.raises(FileFormatError, match=r"one\.csv:1: expected a line of column names"):
        dqc.identify(path, arm_of(1))


@pytest.mark.slow
def test_the_twin_of_a_log_does_what_the_robot_did(tmp_path):
    """Saved as two runs that `dqcontrol compare` reads, with the report beside them."""
    from dqcontrol.experiments import load_runs
    from dqcontrol.reports.study_reports import write_identification_report

    rng = np.random.default_rng(SEED)
    time = np.arange(1500) * 0.008
    targets = np.column_stack([multisine(rng, time, 0.2) for _ in range(6)])
    seen = np.column_stack(
        [answer(time, each, 0.04 + 0.01 * i, 0.0165, time) for i, each in enumerate(targets.T)]
    )
    path = write_log(tmp_path / "log.csv", time, targets, encoder(rng, seen, 0.0, 1e-4))
    found = dqc.identify(path, "ur5")
    assert len(found.fitted) == 6
    out = found.save(tmp_path / "out")
    replay = found.save_replay(out)
    assert replay.motion_rms > 5e-3
    assert replay.hand_rms < 0.05 * replay.motion_rms
    runs = load_runs([out / "log", out / "replay"])
    rms = [run.metrics.position.rms for run in runs.values()]
    assert rms[0] == pytest.approx(rms[1], rel=0.05)
    write_identification_report(found, out)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "what is left all along" in page
    with pytest.raises(ValueRangeError, match=r"has no plant\.yaml; save the identification there first"):
        found.save_replay(tmp_path)


def test_of_ambiguous_joints_the_plant_has_the_sum_that_is_known():
    known = JointIdentification("a", "fitted", lag=0.05, delay=0.02, gain=1.0, noise=0.0, late=0.07)
    ambiguous = JointIdentification("b", reason="ambiguous: …", late=0.11)
    found = dqc.logs.Identification("arm", (), "positions", 0.008, (known, ambiguous))
    assert found.plant().time_constant == [0.05, pytest.approx(0.09)]
    assert found.plant().delay == [0.02, 0.02]


@pytest.mark.parametrize("velocities", [pytest.param(False, marks=pytest.mark.slow), True])
def test_the_twin_of_a_log_whose_stamps_jitter_drops_and_doubles_no_command(tmp_path, velocities):
    """Stamps with 0.2 ms of jitter, and a period that is not their median step to the last digit."""
    rng = np.random.default_rng(SEED)
    time = np.arange(3000) * 0.008
    targets = np.column_stack([multisine(rng, time, 0.2) for _ in range(6)])
    seen = np.column_stack([answer(time, each, 0.05, 0.02, time) for each in targets.T])
    stamps = time + 2e-4 * rng.normal(size=len(time))
    measured = encoder(rng, seen, 0.0, 1e-5)
    if velocities:
        speeds = np.vstack([np.diff(targets, axis=0), np.zeros(6)]) / 0.008
        names = ["time", *(f"q{i + 1}" for i in range(6)), *(f"u{i + 1}" for i in range(6))]
        path = tmp_path / "log.csv"
        rows = np.column_stack([stamps, measured, speeds])
        np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")
    else:
        path = write_log(tmp_path / "log.csv", stamps, targets, measured)
    found = dqc.identify(path, "ur5")
    for joint in found.joints:
        assert joint.lag == pytest.approx(0.05, rel=0.02)
    replay = found.save_replay(found.save(tmp_path / "out"))
    assert replay.motion_rms > 5e-3
    assert replay.hand_rms < 0.1e-3  # 0.33 mm where rows are dropped or doubled
