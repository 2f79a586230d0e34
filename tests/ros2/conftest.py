"""Nodes in processes of their own, on the loopback, in a ROS domain that is the test's own."""

import fcntl
import os
import resource
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import pytest
import yaml
from nodes import NODES, PATIENCE, read_until

from dqcontrol.ros2 import middleware

SPEC = {
    "name": "tiny",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 2.0},
    "law": {"kind": "proportional", "gain": 5},
    "plant": {"kind": "servo"},
}


@pytest.fixture(scope="session", autouse=True)
def domain():
    """Keep this process and its children to the loopback, and to a domain that no other process of tests has."""
    middleware.stay_on_loopback()
    for number in range(1, 101):  # the ports of more would be others' on Linux
        lock = open(Path(tempfile.gettempdir()) / f"dqcontrol-ros-domain-{number}", "w")  # noqa: SIM115
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        with lock:  # the system lets it go when this process and those it started have ended, however they do
            os.environ["ROS_DOMAIN_ID"] = str(number)
            yield lock
        return
    raise RuntimeError("all ROS domains are taken")


@pytest.fixture
def spec(tmp_path):
    """Return what writes a spec, with changes, and gives its path."""

    def write(name="spec.yaml", **changes):
        (tmp_path / name).write_text(yaml.safe_dump({**SPEC, **changes}))
        return tmp_path / name

    return write


@pytest.fixture
def start(domain):
    """Return what starts a ``dqcontrol ros2`` process and waits for a line of its log; all are ended after the test.

    They hold the lock of the domain, too: nodes whose tests were killed would answer in place of those of other tests.
    """
    running = []

    def run(*words, until=None, file_limit=resource.RLIM_INFINITY, program=NODES):
        process = subprocess.Popen(
            [*program, *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            pass_fds=(domain.fileno(),),
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit)),
        )
        running.append(process)
        if until:
            read_until(process, until)
        return process

    yield run
    for process in running:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    for process in running:
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()


@pytest.fixture
def node():
    """Return a node of this process, and what serves it until a condition holds."""
    import rclpy
    import rclpy.utilities
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    rclpy.init()
    probe = Node("probe")
    executor = SingleThreadedExecutor()
    executor.add_node(probe)

    def serve(until=lambda: False, seconds=PATIENCE):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if until():
                return True
            executor.spin_once(timeout_sec=0.02)
        return until()

    def publish(publisher, message, until):
        """Publish until something has come of it: a best-effort subscriber may miss any one message."""
        return serve(lambda: publisher.publish(message) or until())

    hosted = [probe]

    def host(other):
        executor.add_node(other)
        hosted.append(other)

    def unhost(other):
        executor.remove_node(other)
        hosted.remove(other)
        other.destroy_node()

    probe.serve, probe.publish, probe.host, probe.unhost = serve, publish, host, unhost
    yield probe
    executor.shutdown()
    for one in hosted:
        one.destroy_node()
    rclpy.utilities.try_shutdown()


@pytest.fixture
def call(node):
    """Return what calls one of the controller's services and gives its answer."""
    from std_srvs.srv import Trigger

    def ask(service, name="dqcontrol"):
        client = node.create_client(Trigger, f"/{name}/{service}")
        assert client.wait_for_service(PATIENCE)
        future = client.call_async(Trigger.Request())
        assert node.serve(future.done)
        return future.result()

    return ask


@pytest.fixture
def diagnostics(node):
    """Return the last diagnostics of each node, by its name."""
    from diagnostic_msgs.msg import DiagnosticArray

    last = {}

    def hear(message):
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            last[status.name] = (status.message, values)

    node.create_subscription(DiagnosticArray, "/diagnostics", hear, 10)
    return last
