"""Pipes, devices, sizes and full disks: one line, in no time, and nothing half written."""

import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import zstandard

from dqcontrol.errors import Error, FileFormatError
from dqcontrol.figures import robot_bodies
from dqcontrol.files.yaml_file import LARGEST_YAML, read_yaml
from dqcontrol.logs.joint_log import read_joint_log
from dqcontrol.recording import load_record
from dqcontrol.robots import load_robot

unix = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes with names")


@unix
@pytest.mark.parametrize("name", ["robot.urdf", "robot.yaml", "log.csv", "log.mcap", "log.bag"])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_a_pipe_or_device_is_refused_before_it_is_read(tmp_path, name, kind):
    path = tmp_path / name
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    arm = load_robot("iiwa7")
    read = load_robot if name.startswith("robot") else lambda file: read_joint_log(file, arm)
    with pytest.raises(FileFormatError, match="is no file, but a pipe or a device, which may never end"):
        read(path)


def test_sizes_are_looked_at_before_reading(tmp_path, monkeypatch):
    large = tmp_path / "large.yaml"
    large.write_text("a: 1\n" * (2 * LARGEST_YAML))
    with pytest.raises(FileFormatError, match=r"large\.yaml: has 20\.0 MB; at most 2 MB are read"):
        read_yaml(large, dict)
    urdf = tmp_path / "large.urdf"
    with open(urdf, "wb") as stream:
        stream.truncate(10**12)  # it takes no room
    with pytest.raises(FileFormatError, match=r"large\.urdf: has 1,000,000\.0 MB; at most 20 MB are read"):
        load_robot(urdf)
    archive = tmp_path / "mesh.zip"
    archive.write_bytes(b"PK")
    with pytest.raises(FileFormatError, match=r"mesh\.zip: is no mesh that is read here \(allowed: dae, stl"):
        robot_bodies._loaded(archive)


@pytest.mark.parametrize("honest", [True, False])
def test_a_small_recording_that_expands_without_end_is_refused(tmp_path, honest):
    from mcap.data_stream import RecordBuilder
    from mcap.records import Chunk

    packed = zstandard.compress(bytes(1 << 29))
    builder = RecordBuilder()
    chunk = Chunk(
        compression="zstd",
        data=packed,
        message_end_time=0,
        message_start_time=0,
        uncompressed_crc=0,
        uncompressed_size=1 << 29 if honest else 100,
    )
    chunk.write(builder)
    path = tmp_path / "bomb.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + builder.end())
    assert path.stat().st_size < 100_000
    with pytest.raises(FileFormatError, match=r"bomb\.mcap: holds a chunk of 537 MB; at most 268 MB"):
        load_record(path)


def cli(*arguments, **options):
    command = [sys.executable, "-m", "dqcontrol", *map(str, arguments)]
    return subprocess.run(command, stderr=subprocess.PIPE, check=False, **options)


@pytest.mark.slow
def test_what_an_encoding_lacks_is_replaced(tmp_path):
    done = cli(
        "robots", "show", "iiwa7", stdout=subprocess.PIPE, env=os.environ | {"PYTHONIOENCODING": "latin-1"}
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"reach 0.926 m" in done.stdout


@unix
def test_a_closed_or_full_output_gives_no_traceback():
    closed = cli("robots", "show", "iiwa7", preexec_fn=lambda: os.close(1))
    assert (closed.returncode, closed.stderr) == (0, b"")
    with open("/dev/full", "wb") as full:
        done = cli("robots", "show", "iiwa7", stdout=full)
    assert done.returncode == 2
    assert done.stderr.decode() == "dqcontrol: [Errno 28] No space left on device\n"


WRITE = """
    import resource, sys, tempfile
    from pathlib import Path
    import numpy as np
    from dqcontrol.errors import Error
    from dqcontrol.loop import Record
    from dqcontrol.recording import save_record
    from dqcontrol.recording.export import export_record
    from dqcontrol.experiments.results_folder import new_folder
    from dqcontrol.films.clip import write_clip
    from dqcontrol.files.output_file import whole_file
    from dqcontrol.errors import writing

    count, rng = 3000, np.random.default_rng(0)
    poses = np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (count, 1))
    q = rng.normal(size=(count, 7))
    record = Record(np.arange(count) * 0.01, q, q, q, poses, np.hstack([poses, np.zeros((count, 13))]), list("abcdefg"))
    frames = [rng.integers(0, 255, (64, 64, 3), dtype=np.uint8) for _ in range(30)]
    place = Path(sys.argv[1])

    def saved(folder):
        with new_folder(folder, force=False) as new:
            (new / "spec.yaml").write_text("name: a")
            save_record(record, new / "record.mcap")

    def clipped(path):
        with writing(path), whole_file(path) as draft:
            write_clip(iter(frames), draft, 25.0)

    writers = {"run": saved, "r.mcap": lambda path: save_record(record, path)}
    writers |= dict.fromkeys(("e.csv", "e.parquet", "e.mat"), lambda path: export_record(record, path))
    writers |= dict.fromkeys(("c.mp4", "c.webp", "c.gif"), clipped)
    with tempfile.TemporaryDirectory() as folder:
        for name, write in writers.items():
            write(Path(folder) / name)  # what it compiles cannot be cached on a full disk
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))  # as if the disk were full
    resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
    for name, write in writers.items():
        try:
            write(place / name)
        except (Error, OSError) as error:
            print(name, "\\n" not in str(error))
"""


@pytest.mark.slow
@unix
def test_every_writer_ends_on_a_full_disk_and_leaves_nothing(tmp_path):
    code = textwrap.dedent(WRITE)
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False
    )
    names = ["run", "r.mcap", "e.csv", "e.parquet", "e.mat", "c.mp4", "c.webp", "c.gif"]
    assert done.stdout.split("\n")[:-1] == [f"{name} True" for name in names], done.stderr
    assert list(tmp_path.iterdir()) == []


def test_names_in_a_recording_that_are_numbers_are_refused(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "r.mcap"
    about = {
        "format": "1",
        "samples": "0",
        "stopped": "duration",
        "joint_names": "[1, 2]",
        "input_names": "[1, 2]",
    }
    with open(path, "wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_metadata("dqcontrol", about)
        writer.finish()
    with pytest.raises(
        FileFormatError, match=r"r\.mcap: joint_names: expected a list of names, got \[1, 2\]"
    ):
        load_record(path)


def spoiled(whole, rng):
    """Return a file with some bytes changed, cut off, or doubled."""
    data = bytearray(whole)
    kind = rng.integers(4)
    if kind == 0:
        for place in rng.integers(0, len(data), rng.integers(1, 6)):
            data[place] = rng.integers(256)
    elif kind == 1:
        del data[rng.integers(len(data)) :]
    elif kind == 2:
        first = rng.integers(len(data))
        del data[first : first + rng.integers(1, 200)]
    else:
        first = rng.integers(len(data))
        data[first:first] = data[first : first + 100]
    return bytes(data)


def fuzz_runs(folder, count, seed):
    """Spoil each file of a saved run so often; return how many were refused."""
    import dqcontrol as dqc
    from dqcontrol.experiments import load_run

    spec = {
        "name": "a", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
        "reference": {"kind": "circle", "radius": 0.05, "duration": 0.5},
        "law": {"kind": "proportional", "gain": 5}, "plant": {"kind": "integrator"},
    }  # fmt: skip
    folder.mkdir()
    dqc.run(spec).write_data(folder)
    rng, said = np.random.default_rng(seed), []
    for name in ("record.mcap", "spec.yaml"):
        whole = (folder / name).read_bytes()
        for k in range(count):
            (folder / name).write_bytes(spoiled(whole, rng))
            try:
                _ = load_run(folder).record.error
            except Error as error:
                said.append(str(error))
            except Exception as error:
                raise AssertionError(f"seed {seed}, {name} {k}: {error!r}") from error
        (folder / name).write_bytes(whole)
    assert not [text for text in said if "\n" in text], f"seed {seed}"
    return len(said)


def test_spoiled_runs_are_read_or_refused_in_a_line(tmp_path):
    assert 20 < fuzz_runs(tmp_path / "run", 40, seed=3) <= 80


@pytest.mark.slow
def test_many_spoiled_runs_are_read_or_refused_in_a_line(tmp_path):
    seed = int(np.random.default_rng().integers(10**6))
    print(f"seed {seed}")
    assert fuzz_runs(tmp_path / "run", 2000, seed) > 1000
