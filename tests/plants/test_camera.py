"""The camera above the floor: its frames against the true path, its chance against statistics, the stop without it."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, ValueRangeError
from dqcontrol.experiments.spec import read_spec
from dqcontrol.laws import Proportional
from dqcontrol.plants import Camera, FiducialLoss, Servo
from dqcontrol.recording import load_record, save_record

T = 0.01
COMMAND = np.array([0.3, 0.5, 0.1, 0, 0, 0, 0])


@pytest.fixture(scope="module")
def body():
    return dqc.load_robot("little-john")


def drive(body, camera, count, command=COMMAND, seed=0, **options):
    """Return true and measured configurations at each sample, the first included."""
    live = Servo(camera=camera, **options).start(body, np.zeros(8), T, count, seed)
    q, measured = [live.q.copy()], [live.measured.copy()]
    for _ in range(count):
        live.step(command)
        q.append(live.q.copy())
        measured.append(live.measured.copy())
    return np.array(q), np.array(measured), live


@pytest.mark.parametrize("delay", [0, 1, 7])
@pytest.mark.parametrize("rate", [100.0, 30.0, 12.5])
def test_frames_show_the_pose_of_their_time_and_are_held(body, rate, delay):
    q, measured, _ = drive(body, Camera(rate=rate, delay=delay * T), 200)
    for k in range(1, 201):
        taken = [np.ceil(frame / (rate * T) - 1e-9) for frame in range(500)]
        shown = max((int(sample) for sample in taken if sample + delay <= k), default=0)
        assert measured[k, :3] == pytest.approx(q[shown, :3], abs=1e-15), k
    assert np.array_equal(measured[:, 3:], q[:, 3:]), "joints have encoders"


@pytest.mark.parametrize("delay", [0.005, 0.0175, 0.0601])
def test_a_delay_that_ends_within_a_period_counts_from_the_next_sample(body, delay):
    """The same robot, whose frames are taken at its samples, at a hundredth of the period reads them the same."""
    q, measured, _ = drive(body, Camera(rate=12.5, delay=delay), 60)
    often = Servo(camera=Camera(rate=12.5, delay=delay)).start(body, np.zeros(8), T / 100, 6000, 0)
    for k in range(1, 61):
        for _ in range(100):
            often.step(COMMAND)
        assert measured[k, :3] == pytest.approx(often.measured[:3], abs=1e-12), k
    assert not np.array_equal(measured[-1, :3], q[-1, :3])


def test_noise_and_outliers_are_as_asked_and_seeded(body):
    noisy = Camera(
        rate=100.0,
        position_noise=2e-3,
        angle_noise=5e-3,
        outlier_probability=0.05,
        outlier_position=0.5,
        outlier_angle=0.7,
    )
    q, measured, _ = drive(body, noisy, 20_000, np.zeros(7), seed=4)
    error = (measured - q)[1:, :3]
    outlier = np.abs(error[:, 2]) > 0.35
    assert outlier.mean() == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / 20_000))
    assert error[~outlier].std(axis=0) == pytest.approx([2e-3, 2e-3, 5e-3], rel=0.03)
    assert np.hypot(*error[outlier, :2].T) == pytest.approx(0.5, abs=0.01)
    assert np.abs(error[outlier, 2]) == pytest.approx(0.7, abs=0.03)
    assert error[outlier].mean(axis=0) == pytest.approx([0, 0, 0], abs=0.06), "to all sides"
    again, other = (drive(body, noisy, 50, seed=seed)[1] for seed in (4, 5))
    assert np.array_equal(again, drive(body, noisy, 50, seed=4)[1])
    assert not np.array_equal(again, other)


def test_the_filter_is_of_first_order(body):
    """A base at constant speed is seen late by the filter's time constant, or a little more, in samples."""
    rate, tau = 50.0, 0.2
    straight = np.array([0.4, 0, 0, 0, 0, 0, 0])
    q, measured, _ = drive(body, Camera(rate=rate, filter_time=tau), 400, straight)
    weight = 1 - np.exp(-1 / (rate * tau))
    frames = q[2::2, 0]
    wanted, seen = [], 0.0
    for frame in frames:
        seen += weight * (frame - seen)
        wanted.append(seen)
    assert measured[2::2, 0] == pytest.approx(np.array(wanted), abs=1e-14)
    assert frames[-1] - measured[400, 0] == pytest.approx(0.4 * (1 - weight) / weight / rate, rel=1e-3)


def test_without_frames_base_and_arm_slow_down_stop_and_go_on(body):
    camera = Camera(rate=20.0, losses=[FiducialLoss(time=0.5, duration=1.5)], timeout=0.2, stopping_time=0.4)
    q, measured, live = drive(body, camera, 300)
    age, share = (values[:, 0] for _, values in live.foreseen)
    t = T * np.arange(300)
    lost = np.where((t >= 0.45 - 1e-9) & (t < 2.0 - 1e-9), t - 0.45, 0)  # the last frame is of 0.45 s
    assert age == pytest.approx(np.where(lost > 0, lost, age), abs=1e-12)
    assert (age[lost == 0] < 0.05).all()
    assert share == pytest.approx(np.clip(1 - (lost - 0.2) / 0.4, 0, 1), abs=1e-6)
    turned = np.diff(q[:, 2])
    assert turned == pytest.approx(T * 0.5 * share, abs=1e-12)
    target, decay, joint = T * 0.1 * np.cumsum(share), np.exp(-T / Servo().time_constant), [0.0]
    for wanted in target:
        joint.append(wanted + (joint[-1] - wanted) * decay)
    assert q[:, 3] == pytest.approx(np.array(joint), abs=1e-12)
    assert np.array_equal(q[106, :3], q[200, :3]), "it stands still"
    assert abs(q[200, 3] - q[150, 3]) < 1e-5, "and so does its arm, as soon as its servo is there"
    assert np.array_equal(measured[46, :3], measured[199, :3])
    assert measured[200, :3] == pytest.approx(q[200, :3], abs=1e-15)


def test_a_lost_camera_ends_in_the_record_and_its_files(body, tmp_path):
    camera = Camera(losses=[FiducialLoss(time=0.1, duration=10)], timeout=0.1, stopping_time=0.1)
    far = dqc.references.SetPoint(body.fkm([1.0, 0, 0, 0, 0.5, -0.9, 0.6, 0.2]))
    start = [0, 0, 0, 0, 0.5, -0.9, 0.6, 0.2]
    run = [body, far, Proportional(gain=1.0), Servo(camera=camera), start, T]
    record = dqc.simulate(*run, duration=1.0)
    assert record.readings["camera_age"].units == ("s",)
    assert record.readings["command_share"].values[-1] == 0
    moving = np.abs(np.diff(record.q[:, 0])) > 0
    assert moving[:10].all()
    assert not moving[40:].any()
    again = load_record(save_record(record, tmp_path / "record.mcap"))
    assert np.array_equal(again.readings["command_share"].values, record.readings["command_share"].values)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, r"^plant\.camera\.rate: must be > 0"),
        ({"delay": -1.0}, r"^plant\.camera\.delay: must be ≥ 0"),
        ({"outlier_probability": 1.5}, r"^plant\.camera\.outlier_probability: must be ≤ 1, got 1\.5$"),
        ({"timeout": 0.02}, r"^plant\.camera\.timeout: must be longer than 0\.03333 s, .* got 0\.02 s$"),
        ({"stopping_time": 0.0}, r"^plant\.camera\.stopping_time: must be > 0"),
        ({"angle_noise": np.nan}, r"^plant\.camera\.angle_noise: must be finite"),
    ],
)
def test_bad_cameras(options, message):
    with pytest.raises(ValueRangeError, match=message):
        Camera(**options)


def test_cameras_that_do_not_fit_the_period(body):
    with pytest.raises(
        ValueRangeError, match=r"camera\.rate: must be ≤ 100 Hz, one frame a period, got 120$"
    ):
        drive(body, Camera(rate=120.0), 1)
    with pytest.raises(ValueRangeError, match=r"camera\.delay: must be ≤ 2,000 periods"):
        drive(body, Camera(delay=21.0), 1)
    with pytest.raises(ValueRangeError, match=r"losses\.duration: must be > 0"):
        FiducialLoss(time=1.0, duration=0.0)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"rate": -5}, r"plant\.camera\.rate"),
        ({"outlier_probability": 2}, r"plant\.camera\.outlier_probability"),
        ({"losses": [{"time": 1}]}, r"plant\.camera\.losses\[0\].*duration"),
        ({"losses": [{"time": 1, "duration": 1, "until": 3}]}, r"unknown .*until"),
        ({"frames": 3}, r"frames"),
        ({"delay": "late"}, r"plant\.camera\.delay"),
    ],
)
def test_specs_name_what_is_wrong_with_a_camera(camera, message):
    spec = {
        "name": "seen",
        "robot": "little-john",
        "start": [0.0] * 8,
        "period": T,
        "reference": {"kind": "set-point", "duration": 1},
        "law": {"kind": "proportional", "gain": 1},
        "plant": {"kind": "servo", "camera": camera},
    }
    with pytest.raises(FileFormatError, match=message):
        read_spec(spec)
