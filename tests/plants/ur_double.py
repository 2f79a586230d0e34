"""A double of a UR controller: dashboard, script port and RTDE, as the client ``ur_rtde`` uses them.

Real sockets on an address of the loopback, 500 cycles a second of its own time; no robot, no URScript. It knows what
the client's program does with its registers: `servoJ` goes on to the last target, `speedJ` goes on at the last speed,
a watchdog stops the program, and a program that ends brakes. Like the robot it stops protectively at what its joints
may not do. These bounds are ours, in place of a controller's own checks that are not published:

* joint speed 191 deg/s (the safety limit of an e-Series in its factory preset),
* joint acceleration 40 rad/s² (the most that a client may ask of `speedJ`),
* 10 rad/s² when a program ends or a stop is called for, 20 rad/s² in a protective stop.

`servoJ` is a filter of second order, critically damped, that settles within the look-ahead time.
"""

import math
import socket
import struct
import threading

from robot_double import RobotDouble, exactly, towards, work

CYCLE = 0.002
SPEED, ACCELERATION = math.radians(191.0), 40.0
BRAKE, PROTECTIVE_BRAKE = 10.0, 20.0
SPEEDJ, SERVOJ, SPEED_STOP, SERVO_STOP, SET_WATCHDOG, STOP_SCRIPT = 9, 11, 15, 16, 35, 255
CONTINUOUS = {SPEEDJ, SERVOJ}
TYPES = {"INT32": "i", "UINT32": "I", "DOUBLE": "d", "VECTOR6D": "6d", "UINT64": "Q"}


def kind_of(name):
    if name.startswith(("input_int", "output_int")):
        return "INT32"
    if name.startswith(("input_double", "output_double")) or name == "timestamp":
        return "DOUBLE"
    if name in ("robot_status_bits", "safety_status_bits", "runtime_state"):
        return "UINT32"
    return "VECTOR6D" if name in ("actual_q", "actual_qd", "external_force_torque") else "NOT_FOUND"


class Controller:
    """Joints, registers and the program that reads them."""

    def __init__(
        self, q, version=(5, 11, 0, 0), power=True, in_use=False, moving=0.0, remote=True, reads_late=0
    ):
        self.q, self.qd = list(q), [moving] * len(q)
        self.drift = moving  # rad/s before a program runs
        self.version, self.power, self.in_use, self.remote = tuple(version), power, in_use, remote
        self.reads_late, self.begun = reads_late, 0  # cycles: who only reads hears so late of a new program
        self.cycles, self.running, self.fault = 0, False, ""
        self.ints, self.doubles, self.state = [0] * 48, [0.0] * 48, 1
        self.mode, self.watchdog, self.heard = None, math.inf, 0
        self.fastest = 0.0
        self.commands, self.owner, self.rested = 0, None, 0

    def values(self):
        bits = int(self.power) | int(self.running) << 1
        return {
            "timestamp": self.cycles * CYCLE, "actual_q": self.q, "actual_qd": self.qd, "robot_status_bits": bits,
            "safety_status_bits": 4 if self.fault else 1, "runtime_state": 2 if self.running else 1,
            "output_int_register_0": self.state,
        }  # fmt: skip

    def cycle(self):
        self.cycles += 1
        if self.running:
            self.program()
            self.drift = 0.0
        before = self.qd
        self.qd = [self.drift] * len(self.q) if self.drift and not self.running else self.wanted()
        for wanted, was, joint in zip(self.qd, before, self.q, strict=True):
            change = abs(wanted - was) / CYCLE
            self.fastest = max(self.fastest, abs(wanted))
            if self.fault:
                continue
            if abs(wanted) > SPEED:
                self.stop(f"joint speed {wanted:.3g} rad/s")
            elif change > ACCELERATION * (1 + 1e-9) and not self.drift:
                self.stop(f"joint acceleration {change:.3g} rad/s2")
            elif abs(joint) > 2 * math.pi:
                self.stop("joint position")
        if self.fault:
            self.qd = [towards(was, 0.0, PROTECTIVE_BRAKE * CYCLE) for was in before]
        if any(abs(rate) > 1e-3 for rate in self.qd):
            self.rested = self.cycles + 1
        self.q = [joint + CYCLE * rate for joint, rate in zip(self.q, self.qd, strict=True)]

    def stop(self, why):
        self.fault, self.running, self.mode = why, False, None

    def wanted(self):
        if self.mode == SERVOJ:
            omega = 4 / self.doubles[9]
            return [
                rate + CYCLE * (omega**2 * (target - joint) - 2 * omega * rate)
                for target, joint, rate in zip(self.doubles[:6], self.q, self.qd, strict=True)
            ]
        if self.mode == SPEEDJ:
            step = self.doubles[6] * CYCLE
            return [towards(was, goal, step) for was, goal in zip(self.qd, self.doubles[:6], strict=True)]
        return [towards(was, 0.0, BRAKE * CYCLE) for was in self.qd]

    def program(self):
        if (self.cycles - self.heard) * CYCLE > self.watchdog:
            self.stop("watchdog")
            return
        command = self.ints[0]
        if self.state == 2:  # the client clears its command, then the program is ready again
            self.state = 2 if command else 1
        elif command in CONTINUOUS:
            self.mode = command
        elif command == STOP_SCRIPT:
            self.running, self.mode = False, None
        elif command:
            if command in (SPEED_STOP, SERVO_STOP):
                self.mode = None
                if any(self.qd):  # the client waits until the robot stands
                    return
            if command == SET_WATCHDOG:
                self.watchdog, self.heard = 1 / self.doubles[0], self.cycles
            self.state = 2

    def start_program(self):
        self.running, self.state, self.mode, self.drift = True, 1, None, 0.0
        self.watchdog, self.ints[0], self.begun = math.inf, 0, self.cycles


class Rtde(threading.Thread):
    """One client of RTDE."""

    def __init__(self, double, connection):
        super().__init__(daemon=True)
        self.double, self.connection = double, connection
        self.outputs, self.inputs, self.started = [], [], False

    def run(self):
        try:
            while True:
                size, kind = struct.unpack(">HB", exactly(self.connection, 3))
                self.answer(kind, exactly(self.connection, size - 3))
        except (OSError, ConnectionError):
            pass
        with self.double.lock:
            self.double.clients.discard(self)
            if self.double.robot.owner is self:
                self.double.robot.owner = None
        self.connection.close()

    def send(self, kind, payload):
        self.connection.sendall(struct.pack(">HB", 3 + len(payload), kind) + payload)

    def answer(self, kind, payload):
        controller = self.double.robot
        if kind == ord("V"):
            self.send(kind, b"\x01")
        elif kind == ord("v"):
            self.send(kind, struct.pack(">4I", *controller.version))
        elif kind == ord("O"):
            names = payload[8:].decode().strip(",").split(",")
            self.outputs = [(name, kind_of(name)) for name in names]
            self.send(kind, b"\x01" + ",".join(each for _, each in self.outputs).encode())
        elif kind == ord("I"):
            names = payload.decode().strip(",").split(",")
            taken = controller.in_use or controller.owner not in (None, self)
            kinds = ["IN_USE" if taken else kind_of(name) for name in names]
            if not taken:
                controller.owner = self
                self.inputs.append(list(zip(names, kinds, strict=True)))
            self.send(kind, bytes([len(self.inputs)]) + ",".join(kinds).encode())
        elif kind in (ord("S"), ord("P")):
            self.started = kind == ord("S")
            self.send(kind, b"\x01")
            with self.double.lock:
                self.double.clients.add(self)
        elif kind == ord("U"):
            self.take(payload)

    def take(self, payload):
        controller, at = self.double.robot, 1
        with self.double.lock:
            if not self.double.plugged:
                return
            controller.heard = controller.cycles
            controller.commands += 1
            for name, kind in self.inputs[payload[0] - 1]:
                form = ">" + TYPES[kind]
                if at + struct.calcsize(form) > len(payload):
                    break
                values = struct.unpack_from(form, payload, at)
                at += struct.calcsize(form)
                index = name.rsplit("_", 1)[-1]
                if name.startswith("input_int"):
                    controller.ints[int(index)] = values[0]
                elif name.startswith("input_double"):
                    controller.doubles[int(index)] = values[0]

    def tell(self, values):
        if self.started:
            data = b"\x01"
            for name, kind in self.outputs:
                value = values.get(name, [0.0] * 6 if kind == "VECTOR6D" else 0)
                data += struct.pack(">" + TYPES[kind], *(value if isinstance(value, list) else [value]))
            self.send(ord("U"), data)


class Double(RobotDouble):
    """The controller and its ports."""

    cycle_time = CYCLE
    shown = (*RobotDouble.shown, "commands", "mode")

    def __init__(self, host, **options):
        super().__init__(Controller(**options))
        self.clients = set()
        ports = {29999: self.dashboard, 30002: self.script, 30003: self.script, 30004: self.rtde}
        for port, serve in ports.items():
            listener = socket.create_server((host, port))
            threading.Thread(target=self.accept, args=(listener, serve), daemon=True).start()

    def accept(self, listener, serve):
        while True:
            connection, _ = listener.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=serve, args=(connection,), daemon=True).start()

    def dashboard(self, connection):
        connection.sendall(b"Connected: Universal Robots Dashboard Server\n")
        version = ".".join(map(str, self.robot.version[:3]))
        answers = {"PolyscopeVersion": f"URSoftware {version}.0 (double)", "get serial number": "20260000000"}
        with connection, connection.makefile() as lines:
            for line in lines:
                answer = answers.get(line.strip(), "ok")
                if line.strip() == "is in remote control":
                    answer = str(self.robot.remote).lower()
                if line.strip() == "stop":
                    self.robot.running, self.robot.mode = False, None
                connection.sendall(answer.encode() + b"\n")

    def script(self, connection):
        with connection:
            text = b""
            while part := connection.recv(1 << 16):
                text += part
                if b"def rtde_control():" in text and text.rstrip().endswith(b"end"):
                    with self.lock:
                        if self.robot.power and not self.robot.fault and not self.robot.running:
                            self.robot.start_program()
                    text = b""

    def rtde(self, connection):
        Rtde(self, connection).run()

    def is_driven(self):
        return self.robot.running

    def cycle(self):
        robot = self.robot
        with self.lock:
            robot.cycle()
            values, clients = robot.values(), list(self.clients)
        if robot.running and robot.cycles - robot.begun < robot.reads_late:
            clients = [client for client in clients if client.inputs]
        for client in clients if self.plugged else ():
            try:
                client.tell(values)
            except OSError:
                self.clients.discard(client)


if __name__ == "__main__":
    work(Double)
