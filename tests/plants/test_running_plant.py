"""A plant at work has q, measured and step; what else it has is used, what it has not has a default."""

from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.experiments.spec.spec_files import complete_plants
from dqcontrol.loop import Live, close_loop
from dqcontrol.loop.closed_loop import check_disturbed
from dqcontrol.loop.signals import Readings
from dqcontrol.loop.simulate import supervise
from dqcontrol.plants import CompliantPlant, Integrator, MobilePlant, MujocoPlant, Plant, RunningPlant, Servo
from dqcontrol.plants.plant import Channel, command_mode, lagging_mode, running_plant
from dqcontrol.supervisor import Supervisor

Q0, T = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0]), 0.01
LAW = dqc.laws.ProportionalFeedforward(gain=5.0)


class Robot:
    """A robot of one's own, with the least that one has."""

    def __init__(self, period=T):
        self.q, self.measured, self.period, self.steps = Q0.copy(), Q0.copy(), period, 0

    def step(self, command):
        self.q = self.q + self.period * command
        self.measured = self.q.copy()
        self.steps += 1


class RobotPlant(Plant, frozen=True, kw_only=True, tag="Robot"):
    """A kind of one's own: `start` is all that it has to write."""

    def start(self, robot, q0, period, steps, seed):
        return Robot(period)


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


@pytest.fixture(scope="module")
def circle(arm):
    return dqc.references.Circle(arm.fkm(Q0), radius=0.05, duration=4.0)


def test_the_least_plant_moves_as_the_integrator_does_in_every_loop(arm, circle):
    run = {plant: dqc.simulate(arm, circle, LAW, plant, Q0, T) for plant in (RobotPlant(), Integrator())}
    assert np.allclose(
        run[RobotPlant()].q, run[Integrator()].q, rtol=0, atol=1e-13
    )  # compiled sums are fused
    live = Live(arm, LAW, Robot(), T)
    for _ in range(20):
        live.move(np.array([0.05, 0, 0]), np.zeros(3))
        live.step()
    assert live.condition.startswith("active")
    with pytest.raises(Error, match="cannot move the joints of Robot, whose physics"):
        check_disturbed(Robot())


def test_a_kind_of_ones_own_has_all_that_films_trials_and_files_ask_of_it(arm):
    plant = RobotPlant()
    assert (command_mode(plant), lagging_mode(plant)) == ("integrated", "measured")
    assert plant.file_keys == ()
    assert plant.picture(arm) is None
    assert plant.step_time(T, is_compiled=False) > plant.step_time(T, is_compiled=True)
    assert plant.encoder_errors() == (0.0, 0.0)
    assert not plant.is_ideal
    assert plant.linear_model(arm, Q0, T) is None


def test_what_it_has_is_heard_also_if_it_comes_later(arm, circle):
    robot, samples = Robot(), circle.samples(T * np.arange(60))
    robot.channels, robot.readings = (Channel("heat", (), "K"),), np.array([300.0])

    def step(command):
        Robot.step(robot, command)
        robot.readings[0] += 1.0
        if robot.steps == 30:
            robot.fault = "too hot"

    robot.step = step
    law = LAW.prepare(arm, circle, T)
    watched = supervise(Supervisor(ramp=0.0), law, RobotPlant(), Q0)
    trace = close_loop(law, robot, samples, supervision=watched)
    assert trace.stopped == "faulted at 0.29 s: stop category 0: too hot"
    assert trace.readings["heat"].values[:3, 0].tolist() == [300.0, 301.0, 302.0]


@pytest.mark.parametrize(("age", "stops"), [(0.001, False), (1.0, True), (None, False)])
def test_measurements_that_it_calls_old_stop_it(arm, circle, age, stops):
    class Aged(Robot, RunningPlant):
        pass

    robot = Aged() if age is not None else Robot()
    if age is not None:
        robot.age = age
    law = LAW.prepare(arm, circle, T)
    watched = supervise(Supervisor(ramp=0.0), law, RobotPlant(), Q0)
    trace = close_loop(law, robot, circle.samples(T * np.arange(20)), supervision=watched)
    assert trace.stopped.endswith("measurement stale or impossible") == stops


def test_a_plant_says_what_is_special_about_it():
    measured = {"command_mode": "measured"}
    for kind in (Servo, MujocoPlant, CompliantPlant, MobilePlant):
        assert lagging_mode(kind()) == "integrated"
        assert lagging_mode(kind(**measured)) == "measured"
        assert kind(encoder_noise=0.1).encoder_errors().noise == 0.1
    assert CompliantPlant().step_time(0.01, is_compiled=False) == pytest.approx(5e-5 + 10 * 7e-6)


def test_a_spec_finds_files_that_a_kind_of_plant_names(tmp_path):
    (tmp_path / "mine.yaml").write_text("")
    data = {
        "plants": {
            "a": {"kind": "compliant", "controllers": "mine.yaml"},
            "b": {"kind": "servo", "controllers": "x"},
        }
    }
    complete_plants(data, tmp_path)
    assert data["plants"]["a"]["controllers"] == str(tmp_path / "mine.yaml")
    assert data["plants"]["b"]["controllers"] == "x"
    assert CompliantPlant(controllers="mine.yaml").files() == [Path("mine.yaml")]
    assert Servo().files() == []


def test_defaults_are_those_of_a_plant_that_tells_nothing():
    live = running_plant(Robot())
    assert (live.fault, live.age, live.channels, live.compiled()) == ("", 0.0, (), None)
    assert not live.effort.size
    assert not live.wrench.size
    assert running_plant(live) is live


def test_of_a_robot_of_ones_own_each_quantity_is_asked_once_and_only_what_a_plant_has():
    class Counted(Robot):
        asked, age, compiled = 0, 0.5, True

        @property
        def wrench(self):
            self.asked += 1
            return np.arange(6.0)

        def push(self, row, point, force):
            self.pushed = row

    robot = Counted()
    live = running_plant(robot)
    assert live.wrench[5] == 5
    assert robot.asked == 1
    assert live.age == 0.5
    live.push(3, np.zeros(3), np.zeros(3))
    assert robot.pushed == 3
    assert live.compiled() is None, "a step in machine code is of plants that derive from RunningPlant"


def test_parts_of_a_channel_may_be_a_list():
    class Sensing(Robot):
        channels, readings = (Channel("pressure", ["a", "b"], "Pa"),), np.array([1.0, 2.0])

    readings = Readings(running_plant(Sensing()), 2)
    readings.take(0)
    assert readings.signals(1)["pressure"].values.tolist() == [[1.0, 2.0]]
