"""A double of a Franka's control interface (FCI, version 10): TCP commands, and UDP states and commands in turn.

Real sockets on an address of the loopback; joints that do exactly what the motion generator says, no dynamics. A cycle
is a state sent: the double gives its client ``patience`` s for the answer, whatever the machine does meanwhile, and
then counts the packet as lost. As the documentation of FCI has it, a lost packet is extrapolated at constant
acceleration, and 20 in a row, or a command beyond the limits of velocity, acceleration and jerk (those of an FR3;
that speeds fall towards the ends of the joints is left out), stop the robot with a reflex.
"""

import select
import socket
import struct
import threading
import time
from contextlib import suppress

from robot_double import RobotDouble, exactly, towards, work

CYCLE = 0.001
CONNECT, MOVE, STOP_MOVE, RECOVER, MODEL = 0, 1, 2, 10, 11
SUCCESS, STARTED, PREEMPTED, REJECTED, REFLEX = 0, 1, 2, 5, 8
IDLE, MOVING, IN_REFLEX = 1, 2, 4  # of robot_mode
POSITION, VELOCITY = 0, 1  # motion generators of a Move
ERRORS = {
    "joint_motion_generator_position_limits_violation": 12,
    "joint_motion_generator_velocity_limits_violation": 13,
    "joint_motion_generator_velocity_discontinuity": 14,
    "joint_motion_generator_acceleration_discontinuity": 15,
    "communication_constraints_violation": 25,
}
LOWER = [-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]
UPPER = [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]
SPEED = [2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]
ACCELERATION, JERK = [10.0] * 7, [5000.0] * 7
ORIGINS = [  # of the joints: rpy and xyz, from the DH parameters that the documentation prints
    ("0 0 0", "0 0 0.333"), ("-1.570796 0 0", "0 0 0"), ("1.570796 0 0", "0 -0.316 0"),
    ("1.570796 0 0", "0.0825 0 0"), ("-1.570796 0 0", "-0.0825 0.384 0"), ("1.570796 0 0", "0 0 0"),
    ("1.570796 0 0", "0.088 0 0"),
]  # fmt: skip
LOST = 20  # packets in a row
STATE = struct.Struct(
    "<Q" + "16f" * 6 + "f9f3f" * 2 + "4f" + "7f" * 8 + "7f6f7f6f" + "7f6f6f6f" + "3f2f2f2f" + "16f6f6f" + "14f36f"
    "BB41B41BBf"
)  # fmt: skip
COMMAND = struct.Struct("<Q7d7d16d6d2d??7d?")
UNIT = [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def model():
    """The URDF that the client asks for: joints and limits, links of one kilogram."""
    link = (
        '<link name="link{}"><inertial><origin xyz="0 0 0"/><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    joint = (
        '<joint name="joint{}" type="revolute"><origin rpy="{}" xyz="{}"/><parent link="link{}"/>'
        '<child link="link{}"/><axis xyz="0 0 1"/><limit effort="87" lower="{}" upper="{}" velocity="{}"/>'
        '<position_based_velocity_limits deceleration_limit="6.0" velocity_offset="0.3"/></joint>'
    )
    rows = zip(ORIGINS, LOWER, UPPER, SPEED, strict=True)
    joints = [
        joint.format(i, rpy, xyz, i - 1, i, lower, upper, speed)
        for i, ((rpy, xyz), lower, upper, speed) in enumerate(rows, 1)
    ]
    flange = (
        '<joint name="joint8" type="fixed"><origin xyz="0 0 0.107"/>'
        '<parent link="link7"/><child link="link8"/></joint>'
    )
    return f'<robot name="fr3">{"".join(link.format(i) for i in range(9))}{"".join(joints)}{flange}</robot>'


class Arm:
    """Joints, what is wanted of them, and what of that they refuse."""

    def __init__(self, q, moving=0.0):
        self.q, self.qd, self.qdd = list(q), [moving] * 7, [0.0] * 7
        self.moving = moving
        self.mode, self.generator, self.fault = IDLE, None, ""
        self.cycles, self.lost, self.lost_in_all, self.rested = 1, 0, 0, 0
        self.fastest = 0.0
        self.heard = 0

    def packed(self):
        zeros, errors = [0.0] * 200, [0] * 41
        if self.fault:
            errors[ERRORS[self.fault]] = 1
        busy = self.generator is not None
        return STATE.pack(
            self.cycles, *UNIT * 6, *zeros[:26], *zeros[:4], *zeros[:21], *self.q, *self.q, *self.qd, *self.qd,
            *self.qdd, *zeros[:26], *zeros[:25], *zeros[:9], *UNIT, *zeros[:12], *self.q, *self.qd, *zeros[:36],
            1 + self.generator if busy else 0, 0 if busy else 3, *errors, *errors, self.mode, 1.0 if busy else 0.0,
        )  # fmt: skip

    def wanted(self, command):
        """Joint velocities of the next cycle; without a command those at the last acceleration."""
        if self.generator is None:
            if self.moving:
                return self.qd
            steps = [limit * CYCLE for limit in ACCELERATION]
            return [towards(was, 0.0, step) for was, step in zip(self.qd, steps, strict=True)]
        if command is None:
            return [was + CYCLE * rate for was, rate in zip(self.qd, self.qdd, strict=True)]
        if self.generator == VELOCITY:
            return list(command[8:15])
        return [(target - joint) / CYCLE for target, joint in zip(command[1:8], self.q, strict=True)]

    def cycle(self, command):
        self.cycles += 1
        wanted = self.wanted(command)
        if self.generator is not None:
            self.lost = 0 if command else self.lost + 1
            self.lost_in_all += not command
            self.heard = self.cycles if command else self.heard
            if fault := self.refused(wanted):
                self.fault, self.mode, self.generator = fault, IN_REFLEX, None
                wanted = self.wanted(None)
        self.qdd = [(new - was) / CYCLE for new, was in zip(wanted, self.qd, strict=True)]
        self.qd = wanted
        self.q = [joint + CYCLE * rate for joint, rate in zip(self.q, self.qd, strict=True)]
        self.fastest = max(self.fastest, *map(abs, self.qd))
        if any(abs(rate) > 1e-4 for rate in self.qd):
            self.rested = self.cycles + 1

    def refused(self, wanted):
        if self.lost >= LOST:
            return "communication_constraints_violation"
        for i, new in enumerate(wanted):
            rate = (new - self.qd[i]) / CYCLE
            jerk = abs(rate - self.qdd[i]) / CYCLE
            if not LOWER[i] <= self.q[i] + CYCLE * new <= UPPER[i]:
                return "joint_motion_generator_position_limits_violation"
            if abs(new) > SPEED[i]:
                return "joint_motion_generator_velocity_limits_violation"
            if abs(rate) > ACCELERATION[i]:
                return "joint_motion_generator_velocity_discontinuity"
            if jerk > JERK[i]:
                return "joint_motion_generator_acceleration_discontinuity"
        return ""


class Double(RobotDouble):
    """The arm behind its ports; one client at a time, as with FCI."""

    cycle_time = CYCLE
    shown = (*RobotDouble.shown, "mode", "lost_in_all")

    def __init__(self, host, q, version=10, patience=0.02, **options):
        super().__init__(Arm(q, **options))
        self.version, self.patience = version, patience
        self.client, self.move = None, 0
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind((host, 0))
        self.udp.setblocking(False)
        self.address = None
        listener = socket.create_server((host, 1337))
        threading.Thread(target=self.accept, args=(listener,), daemon=True).start()

    def accept(self, listener):
        while True:
            connection, (host, _) = listener.accept()
            late = time.monotonic() + 1.0  # a client that has just ended may not have been noticed
            while self.client is not None and time.monotonic() < late:
                time.sleep(0.01)
            if self.client is not None:
                connection.close()
                continue
            self.client = connection
            threading.Thread(target=self.serve, args=(connection, host), daemon=True).start()

    def serve(self, connection, host):
        try:
            while True:
                kind, number, size = struct.unpack("<III", exactly(connection, 12))
                payload = exactly(connection, size - 12)
                while not self.plugged:
                    time.sleep(0.01)
                with self.lock:
                    self.answer(host, kind, number, payload)
        except OSError:
            pass
        with self.lock:  # a client that is gone moves nothing
            self.address, self.client = None, None
            self.robot.generator = None
            if self.robot.mode == MOVING:
                self.robot.mode = IDLE
        connection.close()

    def reply(self, kind, number, payload):
        with suppress(OSError):
            self.client.sendall(struct.pack("<III", kind, number, 12 + len(payload)) + payload)

    def answer(self, host, kind, number, payload):
        arm = self.robot
        if kind == CONNECT:
            version, port = struct.unpack("<HH", payload[:4])
            self.reply(kind, number, struct.pack("<BH", int(version != self.version), self.version))
            self.address = (host, port)
        elif kind == MODEL:
            self.reply(kind, number, b"\0" + model().encode())
        elif kind == MOVE:
            _, generator = struct.unpack("<II", payload[:8])
            possible = arm.mode == IDLE and generator in (POSITION, VELOCITY)
            self.reply(kind, number, bytes([STARTED if possible else REJECTED]))
            if possible:
                self.move, arm.mode, arm.generator, arm.lost = number, MOVING, generator, 0
                arm.qdd = [0.0] * 7
        elif kind == STOP_MOVE:
            self.reply(kind, number, b"\0")
            self.ended(PREEMPTED)
        else:
            if kind == RECOVER:
                arm.fault, arm.mode = "", IDLE
            self.reply(kind, number, b"\0")

    def ended(self, status):
        if self.move:
            self.robot.generator = None
            self.robot.mode = IN_REFLEX if self.robot.fault else IDLE
            self.reply(MOVE, self.move, bytes([status]))
            self.move = 0

    def heard(self):
        """The answer to the state that was sent last, if it comes in time."""
        until = time.monotonic() + self.patience
        while (left := until - time.monotonic()) > 0 and select.select([self.udp], [], [], left)[0]:
            command = COMMAND.unpack(self.udp.recv(1024))
            if command[0] == self.robot.cycles and self.plugged:
                return command
        return None

    def is_driven(self):
        return self.robot.generator is not None

    def cycle(self):
        with self.lock:
            address, state, busy = self.address, self.robot.packed(), self.robot.generator is not None
        if address and self.plugged:
            self.udp.sendto(state, address)
        command = self.heard() if busy and address else None
        with self.lock:
            if command and command[40]:  # motion_generation_finished
                self.ended(SUCCESS)
                command = None
            before = self.robot.fault
            self.robot.cycle(command)
            if self.robot.fault and not before:
                if self.address and self.plugged:
                    self.udp.sendto(self.robot.packed(), self.address)
                    self.robot.cycles += 1
                self.ended(REFLEX)


if __name__ == "__main__":
    work(Double)
