"""Recordings as other programs write them: MCAP by the mcap library, bags by rosbags."""

import numpy as np
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from dqcontrol.recording.cdr import definition, full_name

EPOCH = 1_700_000_000_123_456_789  # ns: a stamp that a float64 of seconds cannot hold
CIRCLE = {  # a run whose log somebody may have
    "name": "own",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.02,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 2},
    "law": {"kind": "proportional", "gain": 5},
    "plant": {"kind": "integrator"},
}


def joint_state(stamp, names, position=(), velocity=()):
    return (
        "sensor_msgs/JointState",
        stamp,
        {"name": names, "position": list(map(float, position)), "velocity": list(map(float, velocity))},
    )


def pose_stamped(stamp, position, quaternion):
    return "geometry_msgs/PoseStamped", stamp, {"position": position, "orientation": quaternion}


def numbers(values):
    return "std_msgs/Float64MultiArray", None, {"data": list(map(float, values))}


def _xyz(vector):
    return dict(zip("xyz", map(float, vector), strict=True))


def write_mcap(path, messages):
    """Write (topic, time of recording in ns, (type, stamp in ns, fields)) to an MCAP file."""
    with open(path, "wb") as stream, McapWriter(stream) as writer:
        schemas = {}
        for topic, recorded, (kind, stamp, fields) in messages:
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(full_name(kind), definition(kind))
            body = dict(fields)
            if "orientation" in body:
                w, x, y, z = map(float, body.pop("orientation"))
                body = {
                    "pose": {
                        "position": _xyz(body["position"]),
                        "orientation": {"w": w, "x": x, "y": y, "z": z},
                    }
                }
            if stamp is not None:
                second, nano = divmod(stamp, 10**9)
                body["header"] = {"stamp": {"sec": second, "nanosec": nano}, "frame_id": "base"}
            writer.write_message(topic, schemas[kind], body, log_time=recorded)
    return path


def write_bag(path, messages, ros=2, storage=StoragePlugin.SQLITE3):
    """Write the same to a ROS 1 bag (a file) or ROS 2 bag (a folder)."""
    store = get_typestore(Stores.ROS2_HUMBLE if ros == 2 else Stores.ROS1_NOETIC)
    types = store.types
    opened = Writer2(path, version=9, storage_plugin=storage) if ros == 2 else Writer1(path)
    with opened as writer:
        connections = {}
        for topic, recorded, (kind, stamp, fields) in messages:
            name = full_name(kind)
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            message = _message(types, ros, name, stamp, fields)
            serialize = store.serialize_cdr if ros == 2 else store.serialize_ros1
            writer.write(connections[topic], recorded, serialize(message, name))
    return path


def _message(types, ros, name, stamp, fields):
    parts = []
    if stamp is not None:
        time = types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
        first = {"seq": 0} if ros == 1 else {}
        parts.append(types["std_msgs/msg/Header"](**first, stamp=time, frame_id="base"))
    if "orientation" in fields:
        w, x, y, z = map(float, fields["orientation"])
        point = types["geometry_msgs/msg/Point"](**_xyz(fields["position"]))
        turn = types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)
        parts.append(types["geometry_msgs/msg/Pose"](position=point, orientation=turn))
    elif "data" in fields:
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        parts += [layout, np.array(fields["data"], dtype=np.float64)]
    else:
        arrays = [np.array(fields[key], dtype=np.float64) for key in ("position", "velocity")]
        parts += [list(fields["name"]), *arrays, np.zeros(0)]
    return types[name](*parts)
