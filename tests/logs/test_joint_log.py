import sys

import numpy as np
import pytest
from log_files import EPOCH, joint_state, numbers, write_bag, write_mcap
from rosbags.rosbag2 import StoragePlugin

from dqcontrol.errors import Error, FileFormatError, MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.logs.joint_log import read_joint_log
from dqcontrol.robots import SerialArm

ARM = SerialArm.from_dh([0, 0], [0, 0], [1, 1], [0, 0], joint_names=["hip", "knee"], name="leg")
LIFT = SerialArm.from_dh(
    [0, 0], [0, 0], [1, 0], [0, 0], ["revolute", "prismatic"], joint_names=["turn", "lift"]
)
Q = np.array([[0.1, -0.2], [0.15, -0.1], [0.3, 0.05]])
TIME = np.array([0.0, 0.01, 0.03])


def table(tmp_path, text, name="log.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_by_joint_names_in_any_order_with_other_columns_and_comments(tmp_path):
    text = "# a robot\n\nknee, note, time, hip\n-0.2, first, 5, 0.1\n# pause\n-0.1,, 5.01, 0.15\n0.05,x, 5.03, 0.3\n"
    log = read_joint_log(table(tmp_path, text), ARM)
    np.testing.assert_allclose(log.time, TIME, atol=1e-15)
    assert log.q.tolist() == Q.tolist()
    assert log.command is None


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "  ", " , "])
def test_the_delimiter_is_found(tmp_path, delimiter):
    lines = [["time", "q1", "q2"], *([str(t), str(a), str(b)] for t, (a, b) in zip(TIME, Q, strict=True))]
    log = read_joint_log(table(tmp_path, "\n".join(map(delimiter.join, lines))), ARM)
    assert log.q.tolist() == Q.tolist()
    assert log.time.tolist() == TIME.tolist()


def test_a_table_of_numpy_with_a_commented_header(tmp_path):
    path = tmp_path / "log.txt"
    np.savetxt(path, np.column_stack([TIME, Q]), header="time q1 q2")
    np.testing.assert_allclose(read_joint_log(path, ARM).q, Q, rtol=1e-15)


def test_units_behind_the_names_and_commands(tmp_path):
    text = '"time [ms]";q1 [deg];"q2 (rad)";u1 [deg/s];u2\n0;90;1;180;-3\n20;45;2;0;4\n'
    log = read_joint_log(table(tmp_path, text), ARM, angles="deg")
    assert log.time.tolist() == [0, 0.02]
    np.testing.assert_allclose(log.q, [[np.pi / 2, 1], [np.pi / 4, 2]])
    assert log.command is not None
    np.testing.assert_allclose(log.command, [[np.pi, np.radians(-3)], [0, np.radians(4)]])


def test_angles_in_degrees_leave_sliding_joints_in_metres(tmp_path):
    path = table(tmp_path, "time,turn,lift\n0,90,0.5\n1,180,0.25\n")
    np.testing.assert_allclose(read_joint_log(path, LIFT, angles="deg").q, [[np.pi / 2, 0.5], [np.pi, 0.25]])
    path = table(
        tmp_path, "time,turn,lift [mm],command.turn,command.lift [mm/s]\n0,1,500,1,20\n1,2,250,1,30\n"
    )
    log = read_joint_log(path, LIFT)
    np.testing.assert_allclose(log.q, [[1, 0.5], [2, 0.25]])
    assert log.command is not None
    np.testing.assert_allclose(log.command, [[1, 0.02], [1, 0.03]])


def test_angles_that_must_be_degrees_are_not_taken_for_radians(tmp_path):
    path = table(tmp_path, "time,q1,q2\n0,10,20\n1,90,20\n")
    with pytest.raises(
        ValueRangeError, match=r"log\.csv: angles up to 90 rad look like degrees; say which \(--angles"
    ):
        read_joint_log(path, ARM)
    assert read_joint_log(path, ARM, angles="rad").q[1, 0] == 90


@pytest.mark.parametrize(("unit", "first"), [("s", "1700000000.123456789"), ("ns", "1700000000123456789")])
def test_unix_time_keeps_its_nanoseconds(tmp_path, unit, first):
    step = "1700000000.123457790" if unit == "s" else "1700000000123457790"
    log = read_joint_log(table(tmp_path, f"time [{unit}],q1,q2\n{first},0,0\n{step},0,0\n"), ARM)
    assert log.time[1] == pytest.approx(1001e-9, rel=1e-12)


GOOD = "time,q1,q2\n0,1,2\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"log\.csv: is empty; expected a line of column names"),
        ("time,q1,q2\n", r"log\.csv: has no samples below the column names"),
        ("q1,q2\n0,1\n", r"log\.csv:1: column missing: time"),
        ("clock,q1,q2\n0,1,2\n", r"log\.csv:1: column missing: time.*\(columns: clock, q1, q2\)"),
        ("time,hip\n0,1\n", r"log\.csv:1: joints missing: knee \(or q1 … q2\)"),
        ("time,q1\n0,1\n", r"log\.csv:1: joints missing: q2; did you mean 'q1'"),
        ("time,hipp,kne\n0,1,1\n", r"joints missing: hip, knee \(or q1 … q2\); did you mean 'hipp'"),
        ("time,q1,q2,u1\n0,1,1,1\n", r"log\.csv:1: commands missing: u2"),
        ("time,q1,q2,q1\n0,1,1,1\n", r"log\.csv:1: column 'q1' is there 2 times"),
        ("time [h],q1,q2\n0,1,1\n", r"log\.csv:1: time: unknown unit 'h' \(allowed: s, ms"),
        ("time,q1 [m],q2\n0,1,1\n", r"log\.csv:1: q1: unknown unit 'm' \(allowed: rad, deg, °\)"),
        ("time,q1,q2,u1 [rad],u2\n0,1,1,1,1\n", r"log\.csv:1: u1: unknown unit 'rad' \(allowed: rad/s"),
        (GOOD + "1,1\n", r"log\.csv:3: expected 3 values, got 2"),
        (GOOD + "# c\n1,one,2\n", r"log\.csv:4: q1: expected a number, got 'one'"),
        ("time;q1;q2\n0,5;1;2\n", r"log\.csv:2: time: expected a number, got '0,5'; decimals take a point"),
        ("0.0,1,2e-3\n1,1,2\n", r"log\.csv:1: expected a line of column names"),
        (GOOD + "1,1,inf\n", r"log\.csv:3: q2: must be finite, got inf"),
        (GOOD + "1,,1e999\n", r"log\.csv:3: q2: must be finite, got 1e999"),
        (GOOD + "inf,1,1\n", r"log\.csv:3: time: must be finite, got inf"),
        (GOOD + "1,1,1\n1.0,1,1\n", r"log\.csv:4: time: must increase, got 1\.0 after 1"),
        (GOOD + "1,1,1\n0.5,1,1\n", r"log\.csv:4: time: must increase, got 0\.5 after 1"),
        ("time\0,q1,q2", r"log\.csv: not a text file"),
        ("# a\0b\ntime,q1,q2\n0,0,0\n0.01,0,0", r"log\.csv: not a text file"),
        ('time,q1,q2\n0,"1,2\n', r"log\.csv:2: expected 3 values, got 2"),
    ],
)
def test_what_is_wrong_in_a_table_is_named_with_its_line(tmp_path, text, message):
    with pytest.raises(FileFormatError, match=message):
        read_joint_log(table(tmp_path, text), ARM)


def test_a_missing_table_suggests_its_neighbour(tmp_path):
    table(tmp_path, GOOD)
    with pytest.raises(FileFormatError, match=r"lag\.csv: no such file; did you mean 'log\.csv'"):
        read_joint_log(tmp_path / "lag.csv", ARM)


def test_random_damage_to_a_table_raises_only_errors_of_ours(tmp_path):
    rng = np.random.default_rng(7)
    content = "time [s],hip [deg],knee,command.hip,command.knee\n" + "".join(
        f"{k},{k},1,2,3\n" for k in range(9)
    )
    for _ in range(300):
        damaged = bytearray(content.encode())
        for place in rng.integers(0, len(damaged), 3):
            damaged[place] = rng.integers(0, 256)
        (tmp_path / "log.csv").write_bytes(damaged)
        try:
            log = read_joint_log(tmp_path / "log.csv", ARM)
        except Error:
            continue
        assert np.isfinite(log.q).all()
        assert (np.diff(log.time) > 0).all()


def messages(stamped=True):
    """Return joint states with a gripper in between, their order of joints changing, and commands."""
    out = []
    for k, (time, (hip, knee)) in enumerate(zip(TIME, Q, strict=True)):
        stamp = EPOCH + round(time * 1e9)
        recorded = stamp + 500_000
        names, values = (
            (["hip", "knee"], [hip, knee]) if k % 2 else (["knee", "finger", "hip"], [knee, 9, hip])
        )
        out.append(("/joint_states", recorded, joint_state(stamp if stamped else 0, names, values)))
        out.append(("/joint_states", recorded + 1, joint_state(stamp + 1, ["finger"], [1.0])))
        if k:  # commands begin later
            out.append(("/twist", recorded, joint_state(stamp, ["knee", "hip"], [], [10.0 * k, k])))
            out.append(("/raw", stamp, numbers([1.0 * k, 10 * k])))
    return out


WRITERS = {
    "mcap": lambda path, what: write_mcap(path / "log.mcap", what),
    "ros1": lambda path, what: write_bag(path / "log.bag", what, ros=1),
    "sqlite3": lambda path, what: write_bag(path / "log", what),
    "bag-mcap": lambda path, what: write_bag(path / "log", what, storage=StoragePlugin.MCAP),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_every_kind_of_recording_gives_the_same_log(tmp_path, kind):
    path = WRITERS[kind](tmp_path, messages())
    log = read_joint_log(path, ARM)
    np.testing.assert_allclose(log.time, TIME, rtol=1e-15)
    assert log.q.tolist() == Q.tolist()
    assert log.command is None
    assert log.origin == EPOCH
    for topic in ("/twist", "/raw"):
        command = read_joint_log(path, ARM, command_topic=topic).command
        assert command is not None
        assert command.tolist() == [[0, 0], [1, 10], [2, 20]]


@pytest.mark.parametrize("kind", WRITERS)
def test_without_stamps_the_time_of_recording_counts(tmp_path, kind):
    log = read_joint_log(WRITERS[kind](tmp_path, messages(stamped=False)), ARM)
    assert log.origin == EPOCH + 500_000
    np.testing.assert_allclose(log.time, TIME, rtol=1e-15)


def state(k, names=("hip", "knee"), position=(0.0, 0.0)):
    return "/joint_states", EPOCH + k, joint_state(EPOCH + k, list(names), list(position))


@pytest.mark.parametrize("kind", ["mcap", "ros1"])
@pytest.mark.parametrize(
    ("second", "message"),
    [
        (state(1, ["hip", "ankle"]), r"/joint_states: message 2: joints missing: knee \(it has hip, ankle\)"),
        (state(1, position=[0.0, np.nan]), r"/joint_states: message 2: must be finite"),
        (
            state(1, position=[0.0]),
            r"/joint_states: message 2: position: expected 2 numbers as there are names, got 1",
        ),
        (state(0), r"/joint_states: message 2: time must increase, got 0 s after"),
    ],
)
def test_what_is_wrong_in_a_recording_is_named_with_its_message(tmp_path, kind, second, message):
    path = WRITERS[kind](tmp_path, [state(0), second])
    with pytest.raises(FileFormatError, match=rf"log\.(mcap|bag): {message}"):
        read_joint_log(path, ARM)


def test_topics_are_chosen_and_named(tmp_path):
    both = [("/left", EPOCH, state(0)[2]), ("/right", EPOCH, state(0)[2]), ("/raw", EPOCH, numbers([1.0]))]
    path = write_mcap(tmp_path / "two.mcap", both)
    with pytest.raises(
        FileFormatError,
        match=r"several topics of sensor_msgs/JointState; choose one with --joint-topic: /left, /right",
    ):
        read_joint_log(path, ARM)
    assert len(read_joint_log(path, ARM, joint_topic="/right").q) == 1
    with pytest.raises(
        FileFormatError,
        match=r"no topic '/lift'; did you mean '/left'\? \(topics of sensor_msgs/JointState: /left, /right\)",
    ):
        read_joint_log(path, ARM, joint_topic="/lift")
    with pytest.raises(FileFormatError, match=r"/raw holds std_msgs/Float64MultiArray; --joint-topic needs"):
        read_joint_log(path, ARM, joint_topic="/raw")
    with pytest.raises(
        FileFormatError, match=r"/raw: message 1: data: expected 2 numbers, one for each input, got 1"
    ):
        read_joint_log(path, ARM, joint_topic="/left", command_topic="/raw")
    with pytest.raises(FileFormatError, match=r"/left: message 1: velocity: expected 2 numbers"):
        read_joint_log(path, ARM, joint_topic="/left", command_topic="/left")
    path = write_mcap(tmp_path / "none.mcap", both[2:])
    with pytest.raises(FileFormatError, match=r"has no topic of sensor_msgs/JointState \(topics: /raw\)"):
        read_joint_log(path, ARM)
    path = write_mcap(tmp_path / "other.mcap", [state(0, ["finger", "thumb"])])
    with pytest.raises(FileFormatError, match=r"/joint_states: has no message, or none of these joints"):
        read_joint_log(path, ARM)


def test_joints_of_other_names(tmp_path):
    path = write_mcap(tmp_path / "log.mcap", messages())
    other = SerialArm.from_dh([0, 0], [0, 0], [1, 1], [0, 0], name="crane")
    assert read_joint_log(path, other, joints=["hip", "knee"]).q.tolist() == Q.tolist()
    assert read_joint_log(path, other, joints=["knee", "hip"]).q.tolist() == Q[:, ::-1].tolist()
    text = "time,/a/q[0],/a/q[1] [deg],command./a/q[0],command./a/q[1]\n0,1,180,3,4\n1,1,180,3,4\n"
    log = read_joint_log(table(tmp_path, text), other, joints=["/a/q[0]", "/a/q[1]"])
    np.testing.assert_allclose(log.q[0], [1, np.pi])
    assert log.command is not None
    assert log.command[0].tolist() == [3, 4]
    for joints in (["hip"], ["hip", "hip"], []):
        with pytest.raises(
            ShapeError, match=r"joints: crane has 2 joints; expected as many different names, got "
        ):
            read_joint_log(path, other, joints=joints)


def test_an_mcap_file_of_other_than_ros_2_messages_is_named(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "log.mcap"
    with open(path, "wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("sensor_msgs/JointState", "jsonschema", b"{}")
        channel = writer.register_channel("/joint_states", "json", schema)
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    with pytest.raises(FileFormatError, match=r"log\.mcap: /joint_states: holds no ROS 2 messages: "):
        read_joint_log(path, ARM)


def test_a_recording_without_its_index_is_read(tmp_path):
    from mcap.writer import IndexType, Writer
    from mcap_ros2._dynamic import serialize_dynamic

    from dqcontrol.recording.cdr import definition

    kind = "sensor_msgs/msg/JointState"
    encode = serialize_dynamic(kind, definition("sensor_msgs/JointState"))[kind]
    path = tmp_path / "log.mcap"
    with open(path, "wb") as stream:
        writer = Writer(
            stream,
            index_types=IndexType.NONE,
            repeat_channels=False,
            repeat_schemas=False,
            use_chunking=False,
            use_statistics=False,
            use_summary_offsets=False,
        )
        writer.start("ros2")
        schema = writer.register_schema(kind, "ros2msg", definition("sensor_msgs/JointState").encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for k in range(3):
            fields = {
                "header": {"stamp": {"sec": k, "nanosec": 1}},
                "name": ["hip", "knee"],
                "position": [k, 1.0],
            }
            writer.add_message(channel, k, encode(fields), k)
        writer.finish()
    assert read_joint_log(path, ARM).q.tolist() == [[0, 1], [1, 1], [2, 1]]


def test_options_that_do_not_apply_are_refused(tmp_path):
    path = table(tmp_path, GOOD)
    with pytest.raises(ShapeError, match=r"joint_topic: .*log\.csv is a table and has no topics, got '/a'"):
        read_joint_log(path, ARM, joint_topic="/a")
    with pytest.raises(ShapeError, match=r"angles: .*log\.mcap is a recording, and its messages are in rad"):
        read_joint_log(write_mcap(tmp_path / "log.mcap", [state(0)]), ARM, angles="deg")


def test_broken_recordings_are_named(tmp_path):
    for kind, write in WRITERS.items():
        folder = tmp_path / kind
        folder.mkdir()
        path = write(folder, messages())
        file = next(f for f in path.iterdir() if f.suffix in (".db3", ".mcap")) if path.is_dir() else path
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        with pytest.raises(FileFormatError, match=r"is not a complete recording|has no topic"):
            read_joint_log(path, ARM)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match=r"empty: is no ROS 2 bag: it holds no metadata\.yaml"):
        read_joint_log(tmp_path / "empty", ARM)
    with pytest.raises(FileFormatError, match=r"no\.bag: no such file"):
        read_joint_log(tmp_path / "no.bag", ARM)
    with pytest.raises(FileFormatError, match=r"no\.mcap: no such file"):
        read_joint_log(tmp_path / "no.mcap", ARM)
    database = next((tmp_path / "sqlite3" / "log").glob("*.db3"))
    with pytest.raises(FileFormatError, match=r"\.db3: is a part of a ROS 2 bag; give its folder"):
        read_joint_log(database, ARM)


@pytest.mark.slow
@pytest.mark.parametrize("kind", WRITERS)
def test_random_damage_to_a_recording_raises_only_errors_of_one_line(tmp_path, kind):
    path, rng = WRITERS[kind](tmp_path, messages()), np.random.default_rng(9)
    file = next(f for f in path.iterdir() if f.suffix in (".db3", ".mcap")) if path.is_dir() else path
    whole, said = file.read_bytes(), []
    for _ in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 4):
            damaged[place] = rng.integers(0, 256)
        file.write_bytes(damaged)
        try:
            assert np.isfinite(read_joint_log(path, ARM).q).all()
        except Error as error:
            said.append(str(error))
    assert said
    assert all(text.startswith(str(path)) and "\n" not in text for text in said)


def test_bags_without_rosbags_say_what_to_install(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "log", messages())
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(MissingExtraError, match=r"rosbags: bags, .*pip install 'dqcontrol\[data\]'"):
        read_joint_log(path, ARM)


@pytest.mark.slow
def test_a_large_table_is_read_in_few_calls(tmp_path):
    count = 50_000
    path = tmp_path / "log.csv"
    np.savetxt(
        path,
        np.column_stack([np.arange(count) * 1e-3, np.ones((count, 2))]),
        delimiter=",",
        header="time,q1,q2",
    )
    calls = 0

    def note(frame, event, argument):
        nonlocal calls
        calls += 1

    sys.setprofile(note)
    try:
        assert len(read_joint_log(path, ARM).q) == count
    finally:
        sys.setprofile(None)
    assert calls < 40 * count
