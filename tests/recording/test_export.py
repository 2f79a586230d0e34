import csv
import dataclasses
import sys
from typing import Any

import numpy as np
import pytest

from dqcontrol.errors import Error, ExistsError, MissingExtraError, ShapeError, UnknownNameError
from dqcontrol.loop import Record
from dqcontrol.recording import export_record
from dqcontrol.recording.export import signals

UNITS: dict[str, Any] = {"joint_units": ["rad", "m"], "input_units": ["rad", "m"]}
POSE = ("pw", "px", "py", "pz", "dw [m]", "dx [m]", "dy [m]", "dz [m]")
HEADINGS = [
    *["time [s]", "hip [rad]", "lift, ÿ [m]", "measured.hip [rad]", "measured.lift, ÿ [m]"],
    *["command.hip [rad/s]", "command.lift, ÿ [m/s]"],
    *[f"{pose}.{part}" for pose in ("pose", "desired") for part in POSE],
    *["desired_twist.wx [rad/s]", "desired_twist.wy [rad/s]", "desired_twist.wz [rad/s]"],
    *["desired_twist.vx [m/s]", "desired_twist.vy [m/s]", "desired_twist.vz [m/s]"],
    *["desired_twist_rate.wx [rad/s²]", "desired_twist_rate.wy [rad/s²]", "desired_twist_rate.wz [rad/s²]"],
    *["desired_twist_rate.vx [m/s²]", "desired_twist_rate.vy [m/s²]", "desired_twist_rate.vz [m/s²]"],
    *["error", "position_error [m]", "orientation_error [rad]"],
]  # fmt: skip


@pytest.fixture
def record():
    rng = np.random.default_rng(11)
    count = 7
    poses = np.zeros((count, 8))
    angle = rng.uniform(-1, 1, count)
    poses[:, 0], poses[:, 3] = np.cos(angle), np.sin(angle)
    poses[:, 5:8] = poses[:, :1] * [0.1, 0.2, 0.3] / 2
    poses[:, 4] = -poses[:, 3] * 0.3 / 2
    poses[:, 5] -= -0.2 * poses[:, 3] / 2
    poses[:, 6] -= 0.1 * poses[:, 3] / 2
    q, measured, command = rng.normal(size=(3, count, 2))
    q[3, 0] = np.nan  # a diverged run
    time = np.cumsum(rng.uniform(0.01, 0.02, count))
    desired = np.hstack([poses[::-1], rng.normal(size=(count, 13))])
    return Record(
        time, q, measured, command, poses, desired, ("hip", "lift, ÿ"), stopped="diverged: far away"
    )


def columns(record):
    """Return what the file must hold, put together here without the package's list of signals."""
    parts = [record.time, record.q, record.measured, record.command, record.pose, record.desired[:, :20]]
    parts += [record.error, record.position_error, record.orientation_error]
    return np.column_stack(parts)


def test_csv_keeps_every_bit(record, tmp_path):
    path = export_record(record, tmp_path / "new" / "run.csv", **UNITS)
    with open(path, encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    assert header == HEADINGS
    assert np.array(rows, dtype=float).tobytes() == columns(record).tobytes()
    assert [file.name for file in path.parent.iterdir()] == ["run.csv"]


def test_parquet_keeps_every_bit_and_the_notes(record, tmp_path):
    from pyarrow import parquet

    path = export_record(record, tmp_path / "run.parquet", notes={"spec": "law: ÿ\n"}, **UNITS)
    table = parquet.read_table(path)
    assert table.column_names == HEADINGS
    values = np.column_stack([column.to_numpy() for column in table.columns])
    assert values.tobytes() == np.ascontiguousarray(columns(record)).tobytes()
    notes = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    assert notes == {"dqcontrol.stopped": "diverged: far away", "dqcontrol.spec": "law: ÿ\n"}


def test_matlab_keeps_every_bit_names_and_units(record, tmp_path):
    from scipy.io import loadmat

    path = export_record(record, tmp_path / "run.mat", notes={"spec": "law: ÿ\n"}, **UNITS)
    found = loadmat(path, simplify_cells=True)
    names = ["time", "q", "measured", "command", "pose", "desired", "desired_twist", "desired_twist_rate"]
    values = np.column_stack(
        [found[name] for name in (*names, "error", "position_error", "orientation_error")]
    )
    assert values.tobytes() == columns(record).tobytes()
    assert list(found["joint_names"]) == ["hip", "lift, ÿ"]
    assert (found["stopped"], found["spec"]) == ("diverged: far away", "law: ÿ\n")
    assert list(found["units"]["command"]) == ["rad/s", "m/s"]
    assert list(found["units"]["pose"]) == ["1"] * 4 + ["m"] * 4
    assert (found["units"]["time"], found["units"]["error"]) == ("s", "1")


def test_one_joint_and_one_sample_keep_their_shapes(tmp_path):
    from scipy.io import loadmat

    pose = np.eye(8)[:1]
    record = Record(
        np.zeros(1),
        np.ones((1, 1)),
        np.ones((1, 1)),
        np.ones((1, 1)),
        pose,
        np.hstack([pose, np.zeros((1, 13))]),
        ("a",),
    )
    found = loadmat(export_record(record, tmp_path / "one.mat"))
    assert found["q"].tolist() == [[1.0]]
    assert found["joint_names"].shape == (1, 1)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_two_columns_of_one_name_are_refused(record, tmp_path, suffix):
    twins = dataclasses.replace(record, joint_names=("a", "a"))
    with pytest.raises(ShapeError, match=r"joint_names: two columns would be named 'a \[rad\]'"):
        export_record(twins, tmp_path / f"run.{suffix}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mat"])
def test_an_existing_file_is_replaced_only_by_force(record, tmp_path, suffix):
    path = tmp_path / f"run.{suffix}"
    path.write_text("precious")
    with pytest.raises(ExistsError, match=rf"run\.{suffix}: exists; .*--force"):
        export_record(record, path)
    assert path.read_text() == "precious"
    export_record(record, path, force=True)
    assert path.stat().st_size > 1000
    assert len(list(tmp_path.iterdir())) == 1


def test_a_failed_export_keeps_the_old_file(record, tmp_path, monkeypatch):
    path = tmp_path / "run.csv"
    path.write_text("precious")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("dqcontrol.files.output_file.os.replace", fail)
    with pytest.raises(Error, match=r"run\.csv: cannot be written: No space left"):
        export_record(record, path, force=True)
    assert [file.read_text() for file in tmp_path.iterdir()] == ["precious"]


def test_what_cannot_be_written_is_named(record, tmp_path):
    with pytest.raises(
        UnknownNameError,
        match=r"run\.xlsx: suffix: unknown name '\.xlsx' \(allowed: \.csv, \.mat, \.parquet\)",
    ):
        export_record(record, tmp_path / "run.xlsx")
    with pytest.raises(ShapeError, match=r"joint_units: expected 2 units, got 1"):
        signals(record, ["rad"])
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(ExistsError, match=r"folder\.csv: is a folder"):
        export_record(record, tmp_path / "folder.csv", force=True)
    (tmp_path / "file").write_text("")
    with pytest.raises(Error, match=r"run\.csv: cannot be written: (Not a directory|File exists)"):
        export_record(record, tmp_path / "file" / "run.csv")


def test_a_missing_library_is_named(record, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"pyarrow: .*; pip install 'dqcontrol\[data\]'"):
        export_record(record, tmp_path / "run.parquet")
    assert not list(tmp_path.iterdir())
