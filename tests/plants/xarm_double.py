"""A double of an xArm 7's control box: port 502 of commands and port 30001 of reports, as its maker's SDK uses them.

Real sockets on an address of the loopback, 250 cycles a second of its own time, five reports a second; joints that do
exactly what they are told, no dynamics. In velocity mode joints go to a velocity at the acceleration that was set, and
to rest once its duration is over; in servo mode they go to each target in the time since the last one. Like the
controller it stops with error C24 if joints are to be faster than 180 deg/s, and with C23 at the end of a joint. The
limit of the hand's speed in servo mode, error C60, is left out.
"""

import math
import socket
import struct
import threading

from robot_double import RobotDouble, exactly, towards, work

CYCLE = 0.004
VERSION, STATE_TO_SET, STATE, ERRORS, CLEAR_ERROR, MODE, ENABLE = 1, 12, 13, 15, 16, 19, 11
SERVO, ACCELERATION, JOINTS, VELOCITY = 29, 34, 42, 81
MOVES, STANDS, STOPPED, RESET = 1, 2, 4, 5  # states
SERVO_MODE, VELOCITY_MODE = 1, 4
ANGLE, FAST = 23, 24  # error codes
HAS_ERROR, NOT_READY = 0x40, 0x10  # in the byte of state that each answer has
FASTEST, HARDEST = math.pi, 20.0
LOWER = [-2 * math.pi, -2.042, -2 * math.pi, -0.1047, -2 * math.pi, -1.693, -2 * math.pi]
UPPER = [2 * math.pi, 2.0246, 2 * math.pi, 3.927, 2 * math.pi, math.pi, 2 * math.pi]
REPORT = struct.Struct(
    ">IBH"
)  # then little-endian floats, and four bytes of brakes, power, error and warning
REPORTED = 145
EACH = 50  # cycles


class Arm:
    """Joints, what is wanted of them, and what of that they refuse."""

    def __init__(self, q, moving=0.0, version="v2.7.1", error=0):
        self.q, self.qd, self.moving = list(q), [moving] * 7, moving
        self.version, self.error = version, error
        self.mode, self.state, self.enabled = 0, STOPPED if error else STANDS, False
        self.acceleration, self.wanted, self.ends = 8.7266, [0.0] * 7, math.inf
        self.cycles, self.heard, self.rested, self.fastest, self.commands = 0, 0, 0, 0.0, 0

    @property
    def fault(self):
        return f"C{self.error}" if self.error else ""

    def is_ready(self):
        return self.enabled and not self.error and self.state in (MOVES, STANDS)

    def cycle(self):
        self.cycles += 1
        if self.moving:
            goal, self.qd = self.qd, [self.moving] * 7
        elif not self.is_ready() or self.cycles >= self.ends:
            goal = [0.0] * 7
        else:
            goal = self.wanted
        if self.mode == SERVO_MODE and self.is_ready():
            self.qd = list(goal)
        elif not self.moving:
            step = CYCLE * (HARDEST if self.error else self.acceleration)
            self.qd = [towards(was, new, step) for was, new in zip(self.qd, goal, strict=True)]
        self.q = [joint + CYCLE * rate for joint, rate in zip(self.q, self.qd, strict=True)]
        self.fastest = max(self.fastest, *map(abs, self.qd))
        moves = any(abs(rate) > 1e-4 for rate in self.qd)
        if moves:
            self.rested = self.cycles + 1
        if self.is_ready():
            self.state = MOVES if moves else STANDS
            inside = all(a <= q <= b for a, q, b in zip(LOWER, self.q, UPPER, strict=True))
            if not inside:
                self.fail(ANGLE)

    def fail(self, error):
        self.error, self.state = error, STOPPED

    def go(self, wanted, cycles):
        if max(map(abs, wanted)) > FASTEST * (1 + 1e-6):
            self.fail(FAST)
        self.wanted, self.ends = wanted, self.cycles + cycles

    def answer(self, kind, payload):
        """What is answered to a command; what it says is done."""
        if kind == VERSION:
            return f"7,7,XS1305,AC1304,{self.version}".encode().ljust(40, b"\0")
        if kind == STATE:
            return bytes([self.state])
        if kind == ERRORS:
            return bytes([self.error, 0])
        if kind == JOINTS:
            return struct.pack("<7f", *self.q)
        if kind == ENABLE:
            self.enabled = bool(payload[1])
        elif kind == MODE:
            self.mode, self.state, self.wanted = payload[0], RESET, [0.0] * 7
        elif kind == STATE_TO_SET:
            if payload[0] == STOPPED or (self.enabled and not self.error):
                self.state, self.wanted = payload[0] or STANDS, [0.0] * 7
        elif kind == CLEAR_ERROR:
            self.error = 0
        elif kind == ACCELERATION:
            self.acceleration = min(struct.unpack("<f", payload)[0], HARDEST)
        elif kind in (SERVO, VELOCITY) and self.is_ready():
            since, self.heard = max(1, self.cycles - self.heard), self.cycles
            self.commands += 1
            if kind == VELOCITY and self.mode == VELOCITY_MODE:
                duration = struct.unpack_from("<f", payload, 29)[0] if len(payload) > 29 else 0.0
                self.go(
                    list(struct.unpack_from("<7f", payload)), duration / CYCLE if duration > 0 else math.inf
                )
            elif kind == SERVO and self.mode == SERVO_MODE:
                ways = zip(struct.unpack_from("<7f", payload), self.q, strict=True)
                self.go([(target - joint) / (since * CYCLE) for target, joint in ways], since)
        return b""

    def report(self):
        state = REPORT.pack(REPORTED, self.state | self.mode << 4, 0)
        power = 0x7F if self.enabled else 0
        parts = state + struct.pack("<7f", *self.q) + bytes(52) + bytes([power, power, self.error, 0])
        return parts.ljust(REPORTED, b"\0")


class Double(RobotDouble):
    """The control box and its ports; as there, anyone may connect."""

    cycle_time = CYCLE
    shown = (*RobotDouble.shown, "commands", "mode", "error")

    def __init__(self, host, **options):
        super().__init__(Arm(**options))
        self.listeners = set()
        for port, serve in ((502, self.commands), (30001, self.listeners.add)):
            listener = socket.create_server((host, port))
            threading.Thread(target=self.accept, args=(listener, serve), daemon=True).start()

    def accept(self, listener, serve):
        while True:
            connection, _ = listener.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=serve, args=(connection,), daemon=True).start()

    def commands(self, connection):
        try:
            with connection:
                while True:
                    head = exactly(connection, 7)
                    number, protocol, size, kind = struct.unpack(">HHHB", head)
                    payload = exactly(connection, size - 1)
                    if not self.plugged:
                        continue
                    with self.lock:
                        data, arm = self.robot.answer(kind, payload), self.robot
                        state = HAS_ERROR * bool(arm.error) | NOT_READY * (not arm.is_ready())
                    size = 2 + len(data)
                    connection.sendall(struct.pack(">HHHBB", number, protocol, size, kind, state) + data)
        except OSError:
            pass

    def is_driven(self):
        return self.robot.mode == VELOCITY_MODE and self.robot.is_ready()

    def cycle(self):
        with self.lock:
            self.robot.cycle()
            report = self.robot.report()
        if self.robot.cycles % EACH or not self.plugged:
            return
        for connection in list(self.listeners):
            try:
                connection.sendall(report)
            except OSError:
                self.listeners.discard(connection)


if __name__ == "__main__":
    work(Double)
