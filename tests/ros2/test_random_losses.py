"""A node is lost or frozen at a random moment: the robot rests soon, on every interface, and its hand never lunges.

Who stays is in this process, and counts in periods of its own: a busy machine delays both sides, and this is about what
they do. So many trials of each as LOSSES in the environment says; each was once done 200 times.
"""

import os
import signal
import time
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from forks import Forks

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.loop.clock import allows_real_time, real_time, threads_of_process
from dqcontrol.loop.control import Phase
from dqcontrol.ros2.controller_node import ControllerNode
from dqcontrol.ros2.interfaces import COMMANDS
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.robot_node import RobotNode
from dqcontrol_theses.pereira2016.nodes import SIDES, graph_spec

TRIALS = int(os.environ.get("LOSSES", "8"))
AT_REST = 0.1  # s after a loss
WINDOW = 5
UNSEEN = 0.05  # s that a robot may lose without anybody's stopping it
PRIORITY = 20
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL, signal.SIGSTOP)
CIRCLE = {
    "reference": {"kind": "circle", "radius": 0.05, "duration": 60.0, "turns": 10},
    "law": {"kind": "proportional", "gain": 2.0},
    "plant": {"kind": "integrator"},
    "supervisor": {"ramp": 0.0},
}
# torques are of test_effort.py; the latter two are the nodes of Pereira 2016, with trajectories
SETTINGS = [*sorted(COMMANDS.keys() - {"effort"}), "meka", "kuka"]


class CountingRobot(RobotNode):
    """Keeps where it was told to be in each of its periods, and how many it had to make up for at once."""

    def __init__(self, loaded, **options):
        self.path, self.late, self.times = [], [], []
        super().__init__(loaded, **options)

    def _move(self):
        super()._move()
        self.path.append(self._supervisor.position(self._state).copy())
        self.late.append(0)
        self.times.append(time.monotonic())

    def _tick(self):
        before = len(self.path)
        super()._tick()
        if len(self.path) > before:
            self.late[-1] = len(self.path) - before - 1

    def go_back(self, loaded):
        """Be at rest where the spec starts."""
        start = loaded.case.scene.start
        self._plant, self._state = (
            loaded.case.plant.start(loaded.robot, start, loaded.period, 100_000, 0),
            self._supervisor.start(start),
        )

    def moves(self, first):
        """Return which of its periods, from one on, changed where it was told to be."""
        return np.array(
            [np.abs(a - b).max() > 1e-9 for a, b in pairwise(self.path[max(first, 1) - 1 :])], dtype=bool
        )


class CountingController(ControllerNode):
    """Keeps what it commanded in each of its steps, and the joint states that it heard."""

    def __init__(self, *words, **options):
        self.rates, self.times, self.heard, self.steps_heard = [], [], [], 0
        super().__init__(*words, **options)

    def configure(self):
        super().configure()
        following = self.following
        assert following is not None
        step, hear = following._step, following._wrench_input.hear_efforts

        def counted(passed, measured, now):
            step(passed, measured, now)
            self.rates.append(np.abs(following.control.rate).max())
            self.times.append(now)

        def noted(message):
            stamp = message.header.stamp
            self.heard.append((stamp.sec + 1e-9 * stamp.nanosec, *message.position))
            self.steps_heard = len(self.rates)
            hear(message)

        following._step, following._wrench_input.hear_efforts = counted, noted


class Losses:
    """Draws what happens, and judges what came of it."""

    def __init__(self, name, loaded):
        self.seed = time.time_ns() % 100_000
        self.rng, self.name, self.loaded = np.random.default_rng(self.seed), name, loaded
        desired = dqc.algebra.translation(loaded.case.scene.samples[:, :8])
        self.allowed = max(1.1, 1.0 + loaded.law.gain * UNSEEN)  # K makes up for what was lost with its gain
        self.speed = np.linalg.norm(np.diff(desired, axis=0), axis=1).max() / loaded.period  # m/s
        self.counts, self.rests, self.walls, self.ratios = Counter(), [], [], []
        self.excused = self.by_itself = self.done = 0
        print("seed", self.seed, flush=True)

    def draw(self):
        """Return a signal, how long it freezes, s, and whether the process is one in the background."""
        number = SIGNALS[int(self.rng.integers(len(SIGNALS)))]
        return number, float(10 ** self.rng.uniform(-2, 0.2)), bool(self.rng.random() < 0.5)

    def judge_rest(self, periods, made_up, wall, about):
        """Judge how long it moved on: so many periods, of them some that a busy machine had kept for later."""
        self.rests.append(periods - made_up)
        self.walls.append(wall)
        self.excused += bool(made_up)
        assert (periods - made_up) * self.loaded.period <= AT_REST + 1e-9, (
            f"{about}: {periods}, {made_up} made up"
        )

    def judge_speed(self, joints, periods, before, about):
        """Judge the hand along joints, so many periods apart; ``before`` of the rows are from before the loss.

        Its speed is that over WINDOW periods: of two clocks that are not in step, one ticks now and then twice or not
        at all between two ticks of the other.
        """
        hand = dqc.algebra.translation(self.loaded.robot.fkm(np.array(joints)))
        times = np.concatenate(
            [[0.0], np.cumsum(self.loaded.period * np.broadcast_to(periods, len(hand) - 1))]
        )
        speeds = np.linalg.norm(hand[WINDOW:] - hand[:-WINDOW], axis=1) / (times[WINDOW:] - times[:-WINDOW])
        usual = max(self.speed, speeds[: max(before - WINDOW, 0)].max(initial=0.0))
        self.ratios.append(speeds[max(before - WINDOW, 0) :].max(initial=0.0) / usual)
        assert self.ratios[-1] <= self.allowed, f"{about}: {self.ratios[-1]:.3f} times as fast as before"

    def count(self, number, about):
        self.counts[number.name] += 1
        self.done += 1
        rest = f"rests after {self.rests[-1]} periods, " if self.rests else ""
        print(f"{self.name} {self.done} {about}: {rest}{self.ratios[-1]:.3f} of its speed", flush=True)

    def say(self):
        rests, walls = 1e3 * self.loaded.period * np.array(self.rests), 1e3 * np.array(self.walls)
        print(
            f"{self.name}: {self.done} losses, {dict(self.counts)}; {len(rests)} at rest within {rests.max():.0f} ms "
            f"(median {np.median(rests):.0f}) of its own periods, {walls.max():.0f} ms ({np.median(walls):.0f}) by the "
            f"clock; {self.excused} with periods made up for; at most {max(self.ratios):.3f} of its speed; "
            f"{self.by_itself} stopped by themselves before; load {os.getloadavg()[0]:.0f}",
            flush=True,
        )


@pytest.fixture
def scheduled(node):
    """Return options for real-time scheduling where that is allowed; this process then has it too."""
    if not allows_real_time(PRIORITY):
        yield []
        return
    with real_time(PRIORITY, threads_of_process()):
        yield ["--priority", PRIORITY]


@pytest.fixture
def setting(request, spec, tmp_path):
    """Return a spec and its interface."""
    if request.param in COMMANDS:
        return spec(**CIRCLE), request.param
    path, graph = tmp_path / "spec.yaml", graph_spec(SIDES[request.param], "K", "servo")
    graph["plant"]["encoder_noise"] = 0.0  # at rest is at rest
    path.write_text(yaml.safe_dump(graph))
    return path, "trajectory"


def ended(forks, child, about, allowed):
    """Return the log of a child that has ended as it may."""
    code, log = forks.end(child)
    assert code in allowed, f"{about}, code {code}:\n{log}"
    for word in ("Traceback", "ignored in", "terminate called"):
        assert word not in log, f"{about}:\n{log}"
    return log


@pytest.mark.slow
@pytest.mark.parametrize("setting", SETTINGS, indirect=True)
def test_a_robot_that_loses_its_controller_rests_and_never_lunges(
    node, tmp_path, scheduled, setting, request
):
    path, interface = setting
    loaded = load(path)
    robot, losses = (
        CountingRobot(loaded, interface=interface),
        Losses(f"controller {request.node.callspec.id}", loaded),
    )
    node.host(robot)
    words = ("controller", path, "--interface", interface, "--autostart", *scheduled)
    with Forks(path, tmp_path) as forks:
        while losses.done < TRIALS:
            number, pause, background = losses.draw()
            robot.go_back(loaded)
            child = forks.start(words, background)
            assert node.serve(lambda: robot.moves(len(robot.path) - 5).all() or forks.has_ended()), forks.log
            node.serve(forks.has_ended, losses.rng.uniform(0.05, 1.5))
            about = f"{number.name}, background {background}, pause {pause:.3f} s"
            if forks.has_ended() or not robot.moves(len(robot.path) - 5).all():
                losses.by_itself += 1  # a machine that is too busy stops it, and it says so
                if not forks.has_ended():
                    os.kill(child, signal.SIGTERM)
                assert node.serve(forks.has_ended)
                ended(forks, child, "by itself", (0, 2, -15))  # −15: it had ended already
                continue
            at, when = len(robot.path), time.monotonic()
            forks.kill(child, number)
            if number == signal.SIGSTOP:
                node.serve(seconds=pause)
                if pause > 2 * AT_REST:
                    judge_robot(losses, robot, at, when, about)
                os.kill(child, signal.SIGCONT)
                node.serve(forks.has_ended, 0.5)
                if not forks.has_ended():  # a pause so short that it went on
                    os.kill(child, signal.SIGINT)
            assert node.serve(forks.has_ended), about
            if number == signal.SIGKILL:
                node.serve(seconds=0.2)
                judge_robot(losses, robot, at, when, about)
            elif number != signal.SIGSTOP:  # it was brought to rest, and only then left alone
                judge_robot(losses, robot, len(robot.path), time.monotonic(), about)
            log = ended(
                forks, child, about, {signal.SIGKILL: (-9,), signal.SIGSTOP: (0, 2, -2)}.get(number, (0,))
            )
            if number == signal.SIGSTOP and pause > 2 * AT_REST:
                assert "gap in time" in log, about
            node.serve(seconds=0.1)
            assert not robot.moves(len(robot.path) - 3).any(), f"{about}: moves on"
            losses.judge_speed(robot.path[at - 10 :], 1, 10, about)
            losses.count(number, about)
    losses.say()


def judge_robot(losses, robot, at, when, about):
    """Judge how far a robot went on after a loss at one of its periods."""
    moves = np.flatnonzero(robot.moves(at))
    periods = int(moves[-1]) + 1 if len(moves) else 0
    made_up = min(sum(robot.late[at : at + periods + 1]), periods)
    wall = robot.times[at + periods - 1] - when if periods else 0.0
    losses.judge_rest(periods, made_up, wall, about)


@pytest.mark.slow
@pytest.mark.parametrize("setting", SETTINGS, indirect=True)
def test_a_controller_that_loses_its_robot_comes_to_rest(node, tmp_path, scheduled, setting, request):
    path, interface = setting
    controller, loaded = CountingController(path, interface=interface), load(path)
    controller.configure()
    node.host(controller)
    losses, begun = Losses(f"robot {request.node.callspec.id}", loaded), [0]

    def is_stopped():
        return controller.phase is Phase.STOPPED

    def is_moving():
        assert controller.following is not None
        if is_stopped():  # a machine that is too busy stops it
            controller.following.control.reset()
            controller.following.let_go()
        if controller.phase is Phase.INACTIVE:
            try:
                controller.following.activate()
            except Error:
                return False
            begun[0] = len(controller.rates)
        return len(controller.rates) > begun[0] + 20 and controller.rates[-1] > 0.0

    with Forks(path, tmp_path) as forks:
        while losses.done < TRIALS:
            number, pause, background = losses.draw()
            child = forks.start(("robot", path, "--interface", interface, *scheduled), background)
            assert node.serve(is_moving), forks.log
            while node.serve(is_stopped, losses.rng.uniform(0.05, 1.0)):
                losses.by_itself += 1
                assert node.serve(is_moving), forks.log
            about = f"{number.name}, background {background}, pause {pause:.3f} s"
            when, heard = time.monotonic(), len(controller.heard)
            forks.kill(child, number)
            if number == signal.SIGSTOP:
                node.serve(seconds=pause)
                if pause > 2 * AT_REST:
                    judge_controller(losses, controller, when, about)
                os.kill(child, signal.SIGCONT)
                node.serve(seconds=0.3)
                forks.kill(child, signal.SIGINT)
            assert node.serve(forks.has_ended), about
            ended(forks, child, about, (-9,) if number == signal.SIGKILL else (0,))
            assert node.serve(is_stopped), about
            if number != signal.SIGSTOP:
                judge_controller(losses, controller, when, about)
            states = np.array(controller.heard[max(heard - 10, 0) :])
            periods = np.round(np.diff(states[:, 0]) / loaded.period)
            losses.judge_speed(states[:, 1:], periods, min(heard, 10), about)
            losses.count(number, about)
    losses.say()


def judge_controller(losses, controller, when, about):
    """Judge how many of its steps told a robot to move that was not heard any more."""
    at = controller.steps_heard
    moving = np.flatnonzero(controller.rates[at:])
    periods = int(moving[-1]) + 1 if len(moving) else 0
    losses.judge_rest(periods, 0, controller.times[at + periods - 1] - when if periods else 0.0, about)
