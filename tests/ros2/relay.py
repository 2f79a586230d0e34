"""Stands between controller and robot: loses, delays, doubles and swaps messages both ways, and notes all it hears.

relay.py INTERFACE SEED LOSS DELAY TWICE FILE: joint states go from /robot/joint_states to /joint_states, commands from
their topic to /robot/commands. LOSS and TWICE are shares, DELAY the mean of an exponential distribution, s; the faults
begin with the first command. Ended, it writes FILE.npz.
"""

import heapq
import sys
import time
from itertools import count

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from dqcontrol.loop.interrupts import counted_interrupts
from dqcontrol.ros2.interfaces import COMMANDS
from dqcontrol.ros2.messages import nanoseconds

HEARD = QoSProfile(depth=1000)


class Relay:
    def __init__(self, node, interface, seed, faults):
        self.loss, self.delay, self.twice = faults
        self.rng, self.queue, self.number = np.random.default_rng(seed), [], count()
        self.states, self.commands, self.counts = [], [], dict.fromkeys(("lost", "doubled", "swapped"), 0)
        self.last = {"states": -1, "commands": -1}
        topic, kind = COMMANDS[interface]
        self.publishers = {
            "states": node.create_publisher(JointState, "/joint_states", HEARD),
            "commands": node.create_publisher(kind, "/robot/commands", HEARD),
        }
        node.create_subscription(JointState, "/robot/joint_states", self.hear_states, HEARD)
        node.create_subscription(kind, topic, self.hear_command, HEARD)

    def hear_states(self, message):
        self.states.append([nanoseconds(message.header.stamp) * 1e-9, *message.position, *message.velocity])
        self.send("states", message)

    def hear_command(self, message):
        point = message.points[0] if hasattr(message, "points") else None
        self.commands.append([*point.positions, *point.velocities] if point else [*message.data])
        self.send("commands", message)

    def send(self, way, message):
        number, copies = next(self.number), 1
        if self.commands:
            copies = (1 + (self.rng.random() < self.twice)) * (self.rng.random() >= self.loss)
        self.counts["lost"] += copies == 0
        self.counts["doubled"] += copies == 2
        for copy in range(copies):
            late = self.rng.exponential(self.delay) if self.commands else 0.0
            heapq.heappush(self.queue, (time.monotonic() + late, number, copy, way, message))

    def forward(self):
        """Send what is due; return how long until the next is, s."""
        while self.queue and self.queue[0][0] <= time.monotonic():
            _, number, _, way, message = heapq.heappop(self.queue)
            self.counts["swapped"] += number < self.last[way]
            self.last[way] = number
            self.publishers[way].publish(message)
        return max(self.queue[0][0] - time.monotonic(), 0.0) if self.queue else 0.05


def main(interface, seed, loss, delay, twice, file):
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node, executor = rclpy.create_node("relay"), SingleThreadedExecutor()
    relay = Relay(node, interface, int(seed), (float(loss), float(delay), float(twice)))
    executor.add_node(node)
    with (
        counted_interrupts() as interrupts
    ):  # also where SIGINT is ignored, as in what scripts run in the background
        interrupts.only_count()
        print("relays, seed", seed, flush=True)
        while not interrupts.count:
            executor.spin_once(timeout_sec=relay.forward())
        np.savez(file, states=relay.states, commands=relay.commands, **relay.counts)


if __name__ == "__main__":
    main(*sys.argv[1:])
