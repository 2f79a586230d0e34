"""Doubles of robots, each in a process of its own, on an address of the loopback that no other test has."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np

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
        """The state at which something is so, within so many cycles of the double's own time, and within a minute."""
        state = self.state()
        last, late = state["cycles"] + cycles, time.monotonic() + 60
        while not is_so(state):
            assert state["cycles"] < last, state
            assert time.monotonic() < late, state
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


DRIVEN = """
import json, os, signal, sys, time, numpy as np, dqcontrol as dqc
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
for line in sys.stdin:
    asked = json.loads(line)
    if os.fork():
        continue
    try:
        start = np.array(asked["start"])
        plant = getattr(dqc.plants, asked["kind"])(host=asked["host"], **asked["options"])
        live = plant.start(dqc.load_robot(asked["robot"]), start, 0.008, 10, 0)
        for k in range(10000):
            live.step(np.full(len(start), 0.5 * np.cos(0.008 * k)) * min(k / 50, 1))
            if k == 60:
                print("moving", os.getpid(), flush=True)
            if live.fault:
                print("fault", live.fault, flush=True)
                break
            time.sleep(0.008)
    except Exception as error:  # who reads would wait for ever
        print("failed", repr(error), flush=True)
    os._exit(0)
"""


@contextmanager
def drivers():
    """A process that drives robots, each in a child of its own, so that what takes seconds to import is there."""
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVEN], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )
    with process:
        yield process
        process.kill()


def seconds_to_rest(process, how, file, seed, *, kind, robot, start, **options):
    """From the last command that a double heard to its rest, after what drives it, or the cable, failed.

    All joints move at up to 0.5 rad/s then; the moment is drawn by the seed. The double's own time counts.
    """
    moment = np.random.default_rng(seed).uniform(0.0, 0.5)
    with double_of(file, q=start) as double:
        asked = {"kind": kind, "robot": robot, "start": start, "host": double.host, "options": options}
        process.stdin.write(json.dumps(asked) + "\n")
        word, pid = process.stdout.readline().split(maxsplit=1)
        assert word == "moving", pid
        time.sleep(moment)
        if how == "unplug":
            double.state(plugged=False)
        else:
            os.kill(int(pid), {"kill": signal.SIGKILL, "freeze": signal.SIGSTOP}[how])
        state = double.until(lambda state: state["cycles"] > state["rested"] + 0.5 / state["cycle"])
        if how == "unplug":
            assert process.stdout.readline()  # the driver says that the robot is silent
        elif how == "freeze":
            os.kill(int(pid), signal.SIGKILL)
        return (state["rested"] - state["heard"]) * state["cycle"]
