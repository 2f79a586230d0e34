"""What doubles of robots share inside: cycles of their own time, and questions on stdin.

A double is never late by its own clock: what the machine does meanwhile lengthens its cycles.
"""

import json
import os
import select
import sys
import threading
import time


class RobotDouble:
    """A robot behind its ports: a kind has ``robot``, whose ``cycle`` steps it, and says what of it is shown."""

    cycle_time = 0.001  # s
    shown = ("q", "qd", "fault", "cycles", "fastest", "heard", "rested")

    def __init__(self, robot):
        self.robot, self.lock, self.plugged = robot, threading.Lock(), True

    def cycle(self):
        """Step, and tell clients."""
        raise NotImplementedError

    def is_driven(self):
        """Whether a client has the robot in hand."""
        raise NotImplementedError

    def run(self):
        """Step, and answer questions: a line of JSON each, what to set, answered by the state."""
        due = time.monotonic()
        while True:
            self.cycle()
            if select.select([sys.stdin], [], [], 0)[0]:
                line = sys.stdin.readline()
                if not line:
                    return
                self.asked(json.loads(line))
            due = max(due + self.cycle_time, time.monotonic() - self.cycle_time)
            time.sleep(max(0.0, due - time.monotonic()))

    def asked(self, wanted):
        with self.lock:
            self.plugged = wanted.pop("plugged", self.plugged)
            for name, value in wanted.items():
                setattr(self.robot, name, value)
            state = {name: getattr(self.robot, name) for name in self.shown}
            state |= {"is_driven": self.is_driven(), "cycle": self.cycle_time}
        print(json.dumps(state), flush=True)


def exactly(connection, count):
    data = b""
    while len(data) < count:
        part = connection.recv(count - len(data))
        if not part:
            raise ConnectionError
        data += part
    return data


def towards(value, goal, step):
    return max(value - step, min(value + step, goal))


def work(kind):
    """Be a double, as the first argument says; one that fails ends, so that no client waits for it."""

    def fail(args):
        threading.__excepthook__(args)
        os._exit(1)

    threading.excepthook = fail
    double = kind(**json.loads(sys.argv[1]))
    print("ready", flush=True)
    double.run()
