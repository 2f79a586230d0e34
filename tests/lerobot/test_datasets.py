"""Datasets written here, read by LeRobot itself, and the other way round."""

import json

import numpy as np
import pytest

from dqcontrol.files.lerobot_dataset import Episode, Feature, read_dataset, write_dataset

pytestmark = pytest.mark.slow
pytest.importorskip("pyarrow")

READ = """
import json, sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("some/body", root=sys.argv[1])
items = [data[i] for i in range(len(data))]
print("\\n" + json.dumps({
    "fps": data.fps, "episodes": data.num_episodes, "robot": data.meta.robot_type,
    "tasks": [item["task"] for item in items],
    "episode": [int(item["episode_index"]) for item in items],
    "time": [float(item["timestamp"]) for item in items],
    "state": [item["observation.state"].tolist() for item in items],
    "wrench": [item["observation.wrench"].tolist() for item in items],
    "alone": [float(item["alone"]) for item in items],
    "stats": {key: {k: v.tolist() for k, v in each.items()} for key, each in data.meta.stats.items()},
}))
"""
WRITE = """
import sys, numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
feature = {"dtype": "float32", "shape": (2,), "names": ["a.pos", "b.pos"]}
data = LeRobotDataset.create("some/body", 30, {"observation.state": feature, "action": dict(feature)},
                             root=sys.argv[1], robot_type="toy", use_videos=False)
for episode in range(2):
    for k in range(10):
        data.add_frame({"observation.state": np.array([k, episode], np.float32),
                        "action": np.array([k + 0.5, -episode], np.float32), "task": f"number {episode}"})
    data.save_episode()
data.finalize()
"""
FEATURES = {
    "observation.state": Feature(("a.pos", "b.pos"), ("rad", "rad")),
    "observation.wrench": Feature(("fx", "fy", "fz", "tx", "ty", "tz"), ("N",) * 3 + ("N·m",) * 3),
    "alone": Feature(("alone",), ("",)),
    "action": Feature(("a.pos", "b.pos"), ("rad", "rad")),
}


def episode(task, count, seed):
    rng = np.random.default_rng(seed)
    return Episode(task, {name: rng.normal(size=(count, len(each.names))) for name, each in FEATURES.items()})


def test_lerobot_reads_what_is_written(lerobot, tmp_path):
    episodes = [episode("lift", 30, 0), episode("put", 20, 1), episode("lift", 25, 2)]
    write_dataset(tmp_path / "d", 50, FEATURES, episodes, robot_type="toy")
    found = json.loads(lerobot("-c", READ, tmp_path / "d").splitlines()[-1])
    assert (found["fps"], found["episodes"], found["robot"]) == (50, 3, "toy")
    assert found["tasks"] == ["lift"] * 30 + ["put"] * 20 + ["lift"] * 25
    assert found["episode"] == [0] * 30 + [1] * 20 + [2] * 25
    np.testing.assert_allclose(
        found["time"], np.concatenate([np.arange(n) / 50 for n in (30, 20, 25)]), atol=1e-6
    )
    for name, key in (("observation.state", "state"), ("observation.wrench", "wrench"), ("alone", "alone")):
        every = np.vstack([each.values[name] for each in episodes])
        np.testing.assert_allclose(np.array(found[key]).reshape(every.shape), every, atol=1e-6)
        stats = found["stats"][name]
        for part, truth in (
            ("min", every.min(0)),
            ("max", every.max(0)),
            ("mean", every.mean(0)),
            ("std", every.std(0)),
        ):
            np.testing.assert_allclose(stats[part], truth, atol=1e-6)


def test_what_lerobot_writes_is_read(lerobot, tmp_path):
    lerobot("-c", WRITE, tmp_path / "d")
    data = read_dataset(tmp_path / "d")
    assert (data.fps, data.count, data.tasks) == (30, 2, ("number 0", "number 1"))
    assert data.features["action"].names == ("a.pos", "b.pos")
    for k in range(2):
        found = data.episode(k)
        np.testing.assert_allclose(found["observation.state"], np.column_stack([np.arange(10), [k] * 10]))
        np.testing.assert_allclose(found["action"], np.column_stack([np.arange(10) + 0.5, [-k] * 10]))
