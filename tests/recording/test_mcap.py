import dataclasses

import numpy as np
import pytest

from dqcontrol.errors import Error, ExistsError, FileFormatError
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.recording.mcap import load_metadata, load_record, save_record

ARRAYS = ("time", "q", "measured", "command", "pose", "desired")


def pose(axis, angle, position):
    """Return x = r + ε½pr, written out independently of the package."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    w, v, p = np.cos(angle / 2), np.sin(angle / 2) * axis, np.asarray(position, float)
    return np.concatenate([[w], v, [-p @ v / 2], (w * p + np.cross(p, v)) / 2])


def random_record(count=40, seed=5):
    rng = np.random.default_rng(seed)
    poses = np.array([pose(rng.normal(size=3), rng.uniform(0, 6), rng.normal(size=3)) for _ in range(count)])
    time = np.cumsum(rng.uniform(0.001, 0.1, count))
    return Record(
        time,
        rng.normal(size=(count, 3)),
        rng.normal(size=(count, 3)),
        rng.normal(size=(count, 2)),
        poses,
        np.hstack([poses[::-1], rng.normal(size=(count, 13))]),
        ("x", "ÿ", "phi"),
        ("v", "omega"),
        stopped="diverged: q is not finite",
    )


def test_recording_loses_no_bit(tmp_path):
    record = random_record()
    record = dataclasses.replace(record, q=np.where(np.arange(3) == 1, -0.0, record.q))
    path = save_record(record, tmp_path / "new" / "record.mcap", "law: {k: 1}\n")
    again = load_record(path)
    for name in ARRAYS:
        assert getattr(again, name).tobytes() == getattr(record, name).tobytes(), name
    assert (again.joint_names, again.input_names, again.stopped) == (
        record.joint_names,
        record.input_names,
        record.stopped,
    )
    assert load_metadata(path)["spec"] == "law: {k: 1}\n"
    assert [p.name for p in path.parent.iterdir()] == ["record.mcap"]


def test_recording_keeps_times_below_a_nanosecond_below_zero_and_values_that_are_not_finite(tmp_path):
    record = random_record(5)
    q = record.q.copy()
    q[2] = np.nan, np.inf, -np.inf
    record = dataclasses.replace(record, time=-1 + np.arange(5) * 1e-10, q=q)
    again = load_record(save_record(record, tmp_path / "r.mcap"))
    assert again.time.tobytes() == record.time.tobytes()
    assert again.q.tobytes() == record.q.tobytes()


def test_other_tools_read_the_recording_as_ros_messages(tmp_path):
    reader_module = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    record = random_record(6)
    path = save_record(record, tmp_path / "r.mcap")
    messages = {}
    with open(path, "rb") as stream:
        reader = reader_module.make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        assert all(chunk.compression == "zstd" for chunk in reader.get_summary().chunk_indexes)
        for schema, channel, message, ros in reader.iter_decoded_messages():
            messages.setdefault(channel.topic, []).append((schema.name, message.log_time, ros))
    assert all(len(found) == 6 for found in messages.values())
    kind, stamp, hand = messages["/hand/pose"][3]
    assert kind == "geometry_msgs/msg/PoseStamped"
    assert stamp == round(record.time[3] * 1e9)
    assert hand.header.stamp.sec * 10**9 + hand.header.stamp.nanosec == stamp
    p, r = hand.pose.position, hand.pose.orientation
    np.testing.assert_allclose(pose_of(p, r), record.pose[3], atol=1e-14)
    kind, _, states = messages["/joint_states"][3]
    assert (kind, list(states.name)) == ("sensor_msgs/msg/JointState", ["x", "ÿ", "phi"])
    speed = (record.q[4] - record.q[3]) / (record.time[4] - record.time[3])
    np.testing.assert_allclose(states.velocity, speed, rtol=1e-12)
    assert messages["/error"][3][2].data == record.error[3]


@pytest.mark.parametrize(
    ("joints", "inputs"), [("x ÿ phi", "v omega"), ("a", "ω"), ("joint_1 joint_22 j3", "v")]
)
def test_messages_are_byte_for_byte_those_of_the_librarys_encoder(tmp_path, joints, inputs):
    """With names of all lengths modulo four, numbers of all kinds, and what only some runs have."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    from mcap_ros2.writer import Writer

    joints, inputs, rng = joints.split(), inputs.split(), np.random.default_rng(3)
    record = random_record(6)
    q = record.q[:, : len(joints)].copy()
    q[1:5, 0] = np.nan, np.inf, -0.0, 5e-324
    readings = {
        name: Signal(name, tuple(parts), ("m",) * columns, rng.normal(size=(6, columns)))
        for name, parts, columns in (("a", "", 1), ("of two", "xy", 2), ("of seven", "abcdefg", 7))
    }
    record = dataclasses.replace(
        record,
        q=q,
        measured=record.measured[:, : len(joints)],
        command=record.command[:, : len(inputs)],
        joint_names=joints,
        input_names=inputs,
        disturbance=rng.normal(size=(6, 6)),
        readings=readings,
    )
    path = save_record(record, tmp_path / "ours.mcap")
    with open(path, "rb") as ours, open(tmp_path / "theirs.mcap", "wb") as theirs, Writer(theirs) as writer:
        schemas = {}
        reader = make_reader(ours, decoder_factories=[DecoderFactory()])
        for schema, channel, message, ros in reader.iter_decoded_messages(log_time_order=False):
            assert schema
            if schema.name not in schemas:
                schemas[schema.name] = writer.register_msgdef(schema.name, schema.data.decode())
            writer.write_message(channel.topic, schemas[schema.name], ros, log_time=message.log_time)
    written = [(channel.topic, message.data) for channel, message in messages_in(path)]
    assert len({topic for topic, _ in written}) == 13
    assert written == [(channel.topic, message.data) for channel, message in messages_in(theirs.name)]


def test_readers_find_messages_by_the_indexes_and_without_them(tmp_path):
    """Over several chunks, with all checksums; the indexes say the same as those of the library's writer."""
    from mcap.reader import NonSeekingReader, make_reader
    from mcap.writer import Writer

    record = random_record(3000)
    path = save_record(record, tmp_path / "ours.mcap", "law: {k: 1}\n")
    with open(path, "rb") as ours, open(tmp_path / "theirs.mcap", "w+b") as theirs:
        found = make_reader(ours, validate_crcs=True)
        summary, (metadata,) = found.get_summary(), found.iter_metadata()
        assert summary
        assert summary.statistics
        assert [kind.name for kind in summary.metadata_indexes] == ["dqcontrol"]
        ours.seek(0)
        written = [each for _, _, each in NonSeekingReader(ours, True).iter_messages(log_time_order=False)]
        writer = Writer(theirs)
        writer.start("ros2")
        for schema in summary.schemas.values():
            writer.register_schema(schema.name, schema.encoding, schema.data)
        for channel in summary.channels.values():
            writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id)
        writer.add_metadata(metadata.name, metadata.metadata)
        for message in written:
            writer.add_message(**vars(message))
        writer.finish()
        theirs.seek(0)
        expected = make_reader(theirs)
        copied = expected.get_summary()
        assert copied
        assert (summary.channels, summary.schemas) == (copied.channels, copied.schemas)
        assert copied.statistics
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 2
        assert vars(summary.statistics) | {"chunk_count": 0} == vars(copied.statistics) | {"chunk_count": 0}
        middle, end = (round(1e9 * record.time[k]) for k in (1000, 2500))
        some = {"topics": ["/error", "/hand/pose"], "starting_at": middle, "ending_before": end}
        chosen = [[each for _, _, each in reader.iter_messages(**some)] for reader in (found, expected)]
        assert len(chosen[0]) == 3000
        assert chosen[0] == chosen[1]


def messages_in(path):
    from mcap.reader import make_reader

    with open(path, "rb") as stream:
        yield from (found[1:] for found in make_reader(stream).iter_messages(log_time_order=False))


def pose_of(p, r):
    angle = 2 * np.arctan2(np.linalg.norm([r.x, r.y, r.z]), r.w)
    return pose([r.x, r.y, r.z], angle, [p.x, p.y, p.z])


def test_desired_motion_is_the_derivative_of_the_desired_position(tmp_path):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    # A hand on a circle of radius 0.3 m at 2 rad/s, turning with it about z: its inertial twist is the
    # constant [ω; c × ω] with the centre c.
    omega, centre = np.array([0, 0, 2.0]), np.array([0.5, 0.1, 0.4])
    time = np.linspace(0, 0.04, 400)
    arm = np.stack([0.3 * np.cos(2 * time), 0.3 * np.sin(2 * time), 0 * time], axis=1)
    poses = np.array([pose([0, 0, 1], 2 * t, centre + a) for t, a in zip(time, arm, strict=True)])
    twist = np.concatenate([omega, np.cross(centre, omega)])
    desired = np.hstack([poses, np.tile(twist, (400, 1)), np.zeros((400, 6)), time[:, None]])
    q = np.zeros((400, 1))
    path = save_record(Record(time, q, q, q, poses, desired, ("a",)), tmp_path / "r.mcap")
    found = {}
    with open(path, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, ros in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(ros)
    linear = np.array(
        [[m.twist.linear.x, m.twist.linear.y, m.twist.linear.z] for m in found["/hand/desired_twist"]]
    )
    accel = [
        [m.accel.linear.x, m.accel.linear.y, m.accel.linear.z] for m in found["/hand/desired_acceleration"]
    ]
    np.testing.assert_allclose(linear, np.cross(omega, arm), atol=1e-12)
    np.testing.assert_allclose(accel, -4 * arm, atol=1e-12)


def test_an_existing_file_is_not_overwritten(tmp_path):
    path = tmp_path / "r.mcap"
    path.write_text("precious")
    with pytest.raises(ExistsError, match="exists already"):
        save_record(random_record(3), path)
    assert path.read_text() == "precious"


def test_a_failed_write_leaves_nothing(tmp_path, monkeypatch):
    def fail(stream, record, spec):
        stream.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr("dqcontrol.recording.mcap._write", fail)
    with pytest.raises(KeyboardInterrupt):
        save_record(random_record(3), tmp_path / "r.mcap")
    assert not list(tmp_path.iterdir())


def test_damaged_files_are_named(tmp_path):
    whole = save_record(random_record(), tmp_path / "whole.mcap").read_bytes()
    broken = tmp_path / "broken.mcap"
    with pytest.raises(FileFormatError, match=r"missing\.mcap: no such file"):
        load_record(tmp_path / "missing.mcap")
    for content in (b"", b"not mcap at all", whole[: len(whole) // 2], whole[:-1]):
        broken.write_bytes(content)
        with pytest.raises(FileFormatError, match=r"broken\.mcap: is not a complete MCAP file"):
            load_record(broken)
    rng = np.random.default_rng(1)
    for place in rng.integers(0, len(whole), 60):
        bytes_ = bytearray(whole)
        bytes_[place] ^= 0xFF
        broken.write_bytes(bytes_)
        try:
            load_record(broken)
        except Error:
            continue  # the only kind of exception that may come out


def test_a_recording_of_something_else_is_refused(tmp_path):
    from mcap_ros2.writer import Writer

    path = tmp_path / "other.mcap"
    with open(path, "wb") as stream, Writer(stream) as writer:
        schema = writer.register_msgdef("std_msgs/msg/Float64", "float64 data")
        writer.write_message("/a", schema, {"data": 1.0}, log_time=0)
    with pytest.raises(FileFormatError, match=r"other\.mcap: is no record of dqcontrol"):
        load_record(path)


def test_the_folder_of_a_run_is_its_record(tmp_path):
    record = random_record()
    save_record(record, tmp_path / "record.mcap")
    np.testing.assert_array_equal(load_record(tmp_path).q, record.q)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match=r"empty/record\.mcap: no such file"):
        load_record(tmp_path / "empty")
