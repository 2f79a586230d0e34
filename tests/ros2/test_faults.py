"""Controller and robot as processes, and a third between them that spoils their messages: no limit is ever crossed."""

import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from nodes import PATIENCE, PATIENT

import dqcontrol as dqc
from dqcontrol.ros2.interfaces import COMMANDS

ACCELERATION, T = 4.0, 0.01  # rad/s², s
RELAY = Path(__file__).with_name("relay.py")
SPEC = {
    "plant": {"kind": "integrator"},  # shows each command as it is
    "law": {"kind": "proportional", "gain": 20},
    "supervisor": {"acceleration": ACCELERATION, "velocity": 0.25},
}


def spoiled(spec, start, tmp_path, interface, faults, turns, options=()):
    """Return what the relay noted of a run through it, that ends with the controller; a turn takes 3 s."""
    file, seed = tmp_path / "noted.npz", time.time_ns() % 100_000
    circle = {"kind": "circle", "radius": 0.1, "duration": 3.0 * turns, "turns": turns}
    path = spec(**SPEC, reference=circle)
    words = ["-r", "/joint_states:=/robot/joint_states", "-r", f"{COMMANDS[interface][0]}:=/robot/commands"]
    start("robot", path, "--interface", interface, "--", *words)
    program = [sys.executable, "-u", str(RELAY)]
    relay = start(interface, seed, *faults, file, until="relays", program=program)
    controller = start("controller", path, "--interface", interface, "--autostart", *options)
    log, _ = controller.communicate(timeout=PATIENCE)
    relay.send_signal(signal.SIGINT)
    relay.wait(PATIENCE)
    print(log, "seed", seed)
    return np.load(file)


def check(noted, interface):
    """Check velocity, acceleration and position limits of all that was commanded and of all that moved."""
    arm, commands = dqc.load_robot("iiwa7"), noted["commands"]
    stamps, positions, velocities = noted["states"][:, 0], noted["states"][:, 1:8], noted["states"][:, 8:]
    periods = np.round(np.diff(stamps) / T)
    assert periods.min() >= 1
    assert np.isfinite(noted["states"]).all()
    assert np.abs(velocities).max() <= 0.25 * (1 + 1e-6)
    change = np.abs(np.diff(velocities, axis=0)).max(axis=1)
    assert (change <= ACCELERATION * T * periods * (1 + 1e-6) + 1e-9).all(), change.max()
    beyond = np.maximum(arm.limits.lower - positions, positions - arm.limits.upper).max()
    assert beyond < 1e-9  # the command never is, but ideal joints sum its rates, and round
    assert np.abs(velocities).max() > 0.05  # it did move

    assert np.isfinite(commands).all()
    if interface == "velocity":
        rates = commands
    elif interface == "trajectory":
        rates = commands[:, 7:]
    else:
        rates = np.diff(commands, axis=0) / T
    assert np.abs(rates).max() <= 0.25 * (1 + 1e-6)
    assert np.abs(np.diff(rates, axis=0)).max() <= ACCELERATION * T * (1 + 1e-6) + 1e-9
    for what in ("lost", "doubled", "swapped"):
        assert noted[what] > 10, what


@pytest.mark.slow
def test_messages_lost_late_twice_and_swapped_cross_no_limit(spec, start, tmp_path):
    noted = spoiled(spec, start, tmp_path, "velocity", (0.2, 0.01, 0.2), 1, PATIENT)
    check(noted, "velocity")


@pytest.mark.slow
@pytest.mark.parametrize("interface", sorted(COMMANDS.keys() - {"effort"}))  # torques: test_effort.py
@pytest.mark.parametrize("faults", [(0.1, 0.004, 0.1), (0.3, 0.02, 0.3), (0.5, 0.05, 0.5)])
def test_no_fault_crosses_a_limit_on_any_interface(spec, start, tmp_path, interface, faults):
    noted = spoiled(spec, start, tmp_path, interface, faults, 6, PATIENT)
    check(noted, interface)
