"""Doubles of robots, each in a process of its own, on an address of the loopback that no other test has."""

import json
import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

FOLDER = Path(__file__).parent


def own_address():
    """An address of 127.0.0.0/8 that belongs to this process alone: workers of the tests run beside each other."""
    pid = os.getpid()
    return f"127.{1 + (pid >> 16) % 254}.{pid >> 8 & 255}.{1 + pid % 254}"


class DoubleProcess:
    """A double at work: what it is told to be, and what it says that it is."""

    def __init__(self, file, **options):
        self.host = options.pop("host", None) or own_address()
        command = [sys.executable, str(FOLDER / file), json.dumps({"host": self.host, **options})]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        assert self.process.stdout.readline().strip() == "ready"

    def state(self, **wanted):
        """Its state, after it was told something: ``q``, ``qd``, ``fault`` and what else the double says."""
        self.process.stdin.write(json.dumps(wanted) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def until(self, is_so, cycles=5000):
        """The state at which something is so, within so many cycles of the double's own time."""
        state = self.state()
        last = state["cycles"] + cycles
        while not is_so(state):
            assert state["cycles"] < last, state
            time.sleep(0.005)
            state = self.state()
        return state


@contextmanager
def double_of(file, **options):
    double = DoubleProcess(file, **options)
    try:
        yield double
    finally:
        double.process.kill()
        double.process.wait()
        double.process.stdin.close()
        double.process.stdout.close()
