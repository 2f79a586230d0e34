"""LeRobot datasets: what is written is what was recorded, and what is read is what was written."""

import json
import shutil
import sys

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.cli import main
from dqcontrol.errors import ExistsError, FileFormatError, ShapeError, ValueRangeError
from dqcontrol.files.lerobot_dataset import (
    Episode,
    Feature,
    read_dataset,
    whole_rate,
    write_dataset,
)
from dqcontrol.logs import read_joint_log
from dqcontrol.references import load_points

pytest.importorskip("pyarrow")

SPEC = {
    "name": "tiny",
    "robot": "panda",
    "start": [0, -0.8, 0, -2.2, 0, 1.6, 0.8],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 2.0},
    "law": {"kind": "proportional", "gain": 5},
    "plant": {"kind": "servo", "time_constant": 0.05},
}
FEATURES = {
    "observation.state": Feature(("a.pos", "b.pos"), ("rad", "rad")),
    "action": Feature(("a.pos", "b.pos"), ("rad", "rad")),
}


def motion(count, seed=0):
    rng = np.random.default_rng(seed)
    return {"observation.state": rng.normal(size=(count, 2)), "action": rng.normal(size=(count, 2))}


def call(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["dqcontrol", *map(str, arguments)])
    code = 0
    try:
        main()
    except SystemExit as end:
        code = end.code or 0
    return code, *capsys.readouterr()


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    run = dqc.run(SPEC)
    run.save(folder)
    return folder, run


def test_episodes_come_back_as_they_were(tmp_path):
    episodes = [Episode("lift", motion(5)), Episode("put", motion(7, 1)), Episode("lift", motion(3, 2))]
    write_dataset(tmp_path / "d", 50, FEATURES, episodes, robot_type="toy")
    data = read_dataset(tmp_path / "d")
    assert (data.fps, data.count, data.tasks) == (50, 3, ("lift", "put", "lift"))
    assert data.features == FEATURES
    for k, episode in enumerate(episodes):
        found = data.episode(k)
        for name, values in episode.values.items():
            np.testing.assert_array_equal(found[name], values.astype(np.float32))
        np.testing.assert_allclose(found["timestamp"][:, 0], np.arange(len(values)) / 50, atol=1e-7)
    stats = json.loads((tmp_path / "d/meta/stats.json").read_text())["action"]
    every = np.vstack([each.values["action"] for each in episodes])
    np.testing.assert_allclose(stats["mean"], every.mean(0))
    np.testing.assert_allclose(stats["std"], every.std(0))
    assert stats["count"] == [15]


def test_a_run_as_dataset_holds_its_signals_and_comes_back_as_log_and_points(
    ran, tmp_path, monkeypatch, capsys
):
    folder, run = ran
    out = tmp_path / "d"
    code, said, _ = call(monkeypatch, capsys, "convert", folder, out, "--to", "lerobot", "--task", "circle")
    assert code == 0
    assert "1 episode, 201 frames at 100 a second: observation.state, observation.pose" in said
    record = run.record
    log = read_joint_log(out, run.robot)
    np.testing.assert_allclose(log.q, record.measured, atol=1e-6)
    np.testing.assert_allclose(log.time, record.time, atol=1e-12)
    np.testing.assert_allclose(log.command, record.command, atol=1e-6)
    # the commanded positions are what the commands add up to
    np.testing.assert_allclose(np.diff(log.target, axis=0), 0.01 * record.command[1:], atol=1e-6)
    points = load_points(out)
    shown = run.robot.fkm(record.measured[[0, 70, 200]])
    for time, pose in zip((0.0, 0.7, 2.0), shown, strict=True):
        found = points.at(time).pose
        assert min(np.abs(found - pose).max(), np.abs(found + pose).max()) < 1e-6
    assert read_dataset(out).tasks == ("circle",)


def test_a_lower_rate_takes_the_latest_samples(ran, tmp_path, monkeypatch, capsys):
    folder, run = ran
    assert (
        call(monkeypatch, capsys, "convert", folder, tmp_path / "d", "--to", "lerobot", "--fps", 30)[0] == 0
    )
    q = read_dataset(tmp_path / "d").episode(0)["observation.state"]
    assert len(q) == 61
    rows = [int(k / 30 / 0.01 + 1e-6) for k in range(61)]
    np.testing.assert_allclose(q, run.record.measured[rows], atol=1e-6)


def test_a_folder_of_runs_is_a_dataset_of_episodes(ran, tmp_path, monkeypatch, capsys):
    for name in ("first", "second"):
        shutil.copytree(ran[0], tmp_path / "study" / name)
    assert call(monkeypatch, capsys, "convert", tmp_path / "study", tmp_path / "d", "--to", "lerobot")[0] == 0
    data = read_dataset(tmp_path / "d")
    assert data.tasks == ("first", "second")
    found = dqc.identify(tmp_path / "d", "panda")  # a dataset stands for its episodes
    assert [path.name for path in found.logs] == ["d:0", "d:1"]
    with pytest.raises(ValueRangeError, match=r"d: has 2 episodes; name one, as .*d:0"):
        load_points(tmp_path / "d")
    with pytest.raises(ValueRangeError, match="d: has 2 episodes, 0 to 1; got 2"):
        load_points(f"{tmp_path / 'd'}:2")
    assert len(read_joint_log(f"{tmp_path / 'd'}:1", ran[1].robot).time) == 201


def test_servos_are_identified_from_a_dataset_as_from_the_run(tmp_path, monkeypatch, capsys):
    """Lag and delay from the dataset are those of the plant."""
    pytest.importorskip("nlopt")
    arm = dqc.load_robot("panda")
    rng, lag, delay = np.random.default_rng(3), 0.08, 3
    time = np.arange(1500) / 100
    phases, rates = rng.uniform(0, 6, (7, 4)), rng.uniform(0.3, 1.5, (7, 4))
    asked = np.array(SPEC["start"]) + 0.1 * np.sin(6.28 * rates * time[:, None, None] + phases).sum(
        -1
    )  # (N, 7)
    q = np.empty_like(asked)
    q[0] = asked[0]
    for k in range(1, len(time)):  # a first-order lag of held commands, exact
        q[k] = asked[max(k - 1 - delay, 0)] + (q[k - 1] - asked[max(k - 1 - delay, 0)]) * np.exp(-0.01 / lag)
    names = tuple(f"{name}.pos" for name in arm.joint_names)
    feature = Feature(names, ("rad",) * 7)
    values = {"observation.state": q, "action": asked}
    write_dataset(tmp_path / "d", 100, dict.fromkeys(values, feature), [Episode("shake", values)])
    found = dqc.identify(tmp_path / "d", arm)
    for joint in found.joints:
        assert joint.lag == pytest.approx(lag, abs=2e-3)
        assert joint.delay == pytest.approx(0.03, abs=2e-3)


def test_learn_repeats_the_hand_of_a_dataset(ran, tmp_path, monkeypatch, capsys):
    assert call(monkeypatch, capsys, "convert", ran[0], tmp_path / "d", "--to", "lerobot")[0] == 0
    spec = {**SPEC, "name": "again", "reference": {"kind": "points", "file": str(tmp_path / "d")}}
    found = dqc.learn(spec, repeats=3, return_time=1.0)
    assert found.repeats[-1].position < 0.3 * found.repeats[0].position


def test_logs_of_degrees_are_known_by_the_limits(tmp_path):
    arm = dqc.load_robot("panda")
    q = np.rad2deg(np.array(SPEC["start"]) + 0.1 * np.random.default_rng(0).normal(size=(50, 7)))
    names = tuple(f"{name}.pos" for name in arm.joint_names)
    for folder, units in (("unsaid", ("",) * 7), ("said", ("deg",) * 7)):
        write_dataset(
            tmp_path / folder,
            30,
            {"observation.state": Feature(names, units)},
            [Episode("x", {"observation.state": q})],
        )
        log = read_joint_log(tmp_path / folder, arm)
        np.testing.assert_allclose(np.rad2deg(log.q), q, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"codebase_version": "v2.1"}, r"d: is a LeRobot dataset of version v2.1, and v3.0 is read"),
        ({"codebase_version": "v4.0"}, r"version v4.0, and v3.0 is read"),
        ({"fps": 0}, "info.json: fps: must be ≥ 1, got 0"),
        ({"features": [1]}, "info.json: is malformed"),
        ({"data_path": "none/{chunk_index}-{file_index}.parquet"}, "cannot be read"),
    ],
)
def test_what_is_no_dataset_of_this_version_is_refused_in_a_line(tmp_path, change, text):
    write_dataset(tmp_path / "d", 50, FEATURES, [Episode("lift", motion(5))])
    info = tmp_path / "d/meta/info.json"
    info.write_text(json.dumps(json.loads(info.read_text()) | change))
    with pytest.raises(FileFormatError, match=text) as caught:
        read_dataset(tmp_path / "d").episode(0)
    assert "\n" not in str(caught.value)


def test_damaged_files_are_refused_in_a_line(tmp_path):
    write_dataset(tmp_path / "d", 50, FEATURES, [Episode("lift", motion(5))])
    for name in (
        "data/chunk-000/file-000.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
        "meta/info.json",
    ):
        kept = (tmp_path / "d" / name).read_bytes()
        for damaged in (kept[: len(kept) // 2], b"", b"\0" * 100):
            (tmp_path / "d" / name).write_bytes(damaged)
            with pytest.raises(FileFormatError, match="d/") as caught:
                read_dataset(tmp_path / "d").episode(0)
            assert "\n" not in str(caught.value)
        (tmp_path / "d" / name).write_bytes(kept)


def test_the_wrong_robot_is_refused(tmp_path):
    write_dataset(tmp_path / "d", 50, FEATURES, [Episode("lift", motion(5))])
    with pytest.raises(FileFormatError, match=r"observation.state: has no panda_joint1.*; it has a, b"):
        read_joint_log(tmp_path / "d", dqc.load_robot("panda"))


def test_nothing_is_overwritten_unasked_nor_what_is_no_dataset(tmp_path):
    folder = tmp_path / "d"
    write_dataset(folder, 50, FEATURES, [Episode("lift", motion(5))])
    with pytest.raises(ExistsError, match="exists; choose another name"):
        write_dataset(folder, 50, FEATURES, [Episode("lift", motion(4))])
    write_dataset(folder, 50, FEATURES, [Episode("lift", motion(4))], force=True)
    assert len(read_dataset(folder).episode(0)["action"]) == 4
    (tmp_path / "mine").mkdir()
    with pytest.raises(ExistsError, match="mine: is no dataset"):
        write_dataset(tmp_path / "mine", 50, FEATURES, [Episode("lift", motion(5))], force=True)
    with pytest.raises(ShapeError, match=r"action: expected shape \(5, 2\), got \(0,\)"):
        write_dataset(
            tmp_path / "e",
            50,
            FEATURES,
            [Episode("lift", {"observation.state": motion(5)["observation.state"]})],
        )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["d", "mine"]


def test_a_rate_that_is_no_whole_number_is_asked_for(tmp_path, monkeypatch, capsys):
    assert whole_rate(np.arange(100) * 0.004) == 250
    with pytest.raises(ValueRangeError, match=r"fps: the samples come at 333.333 a second.*--fps 333"):
        whole_rate(np.arange(1000) * 0.003)
    dqc.run({**SPEC, "period": 0.003}).save(tmp_path / "odd")
    code, _, said = call(monkeypatch, capsys, "convert", tmp_path / "odd", tmp_path / "d", "--to", "lerobot")
    assert code == 2
    assert "give one, as --fps 333" in said
    code, _, said = call(monkeypatch, capsys, "convert", tmp_path / "odd", tmp_path / "d", "--fps", 30)
    assert code == 2
    assert "--fps: is for datasets: give --to lerobot, too" in said


def test_a_log_becomes_a_dataset(tmp_path, monkeypatch, capsys):
    time = np.arange(200) / 50
    q = np.array(SPEC["start"]) + 0.1 * np.sin(time)[:, None]
    rows = np.column_stack([time, q, q + 0.01])
    heading = ",".join(["time", *(f"q{i}" for i in range(1, 8)), *(f"r{i}" for i in range(1, 8))])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=heading, comments="")
    arguments = "convert", tmp_path / "log.csv", tmp_path / "d", "--to", "lerobot"
    code, _, said = call(monkeypatch, capsys, *arguments)
    assert code == 2
    assert "--robot:" in said
    assert call(monkeypatch, capsys, *arguments, "--robot", "panda")[0] == 0
    log = read_joint_log(tmp_path / "d", dqc.load_robot("panda"))
    np.testing.assert_allclose(log.target, q + 0.01, atol=1e-6)
    np.testing.assert_allclose(log.q, q, atol=1e-6)
