"""The supervisor in the loop: compiled and interpreted alike, halts, signals, specs."""

import signal
import warnings

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.cli.result_commands import figures
from dqcontrol.errors import FileFormatError, ValueRangeError
from dqcontrol.experiments import read_spec
from dqcontrol.laws import ProportionalFeedforward
from dqcontrol.loop import Clock, Supervision, close_loop
from dqcontrol.plants import Integrator, Servo
from dqcontrol.recording import save_black_box
from dqcontrol.supervisor import Supervisor, list_interventions

Q0 = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
T = 0.01
LAW = ProportionalFeedforward(gain=10.0)


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


@pytest.fixture(scope="module")
def circle(arm):
    return dqc.references.Circle(arm.fkm(Q0), radius=0.05, duration=3.0)


@pytest.mark.parametrize("mode", ["integrated", "measured"])
@pytest.mark.parametrize("tracking_error", [0.3, 0.005])
def test_compiled_and_interpreted_are_equal(arm, circle, mode, tracking_error):
    plant = Servo(command_mode=mode, sag=1.0, stiffness=2000.0)
    supervisor = Supervisor(ramp=0.3, tracking_error=tracking_error)
    runs = [
        dqc.simulate(arm, circle, LAW, plant, Q0, T, supervisor=supervisor, interpreted=interpreted)
        for interpreted in (False, True)
    ]
    for name in ("q", "measured", "command"):
        assert np.array_equal(getattr(runs[0], name), getattr(runs[1], name))
    codes = [run.readings["interventions"].values for run in runs]
    assert np.array_equal(*codes)
    assert runs[0].stopped == runs[1].stopped
    if tracking_error == 0.005:
        assert runs[0].stopped.startswith("halted at")
        assert runs[0].stopped.endswith("s: stop category 1: tracking error too large")
        assert len(runs[0]) < 301
        assert list_interventions(runs[0].time, codes[0])[-1].reason == "tracking error too large"
    else:
        assert runs[0].stopped == "duration"


def test_a_run_that_needs_no_help_is_the_same(arm, circle):
    """Nothing to limit but the very first jump of the speed."""
    still = dqc.references.SetPoint(arm.fkm(Q0 + 0.01))
    supervisor = Supervisor(ramp=0.0, acceleration=1e3)
    plain = dqc.simulate(arm, still, LAW, Servo(), Q0, T, 1.0)
    guarded = dqc.simulate(arm, still, LAW, Servo(), Q0, T, 1.0, supervisor=supervisor)
    assert guarded.q[: len(plain)] == pytest.approx(plain.q, abs=1e-12)
    assert not guarded.readings["interventions"].values[: len(plain)].any()
    assert len(guarded) == len(plain) + 1, "one sample more, that brakes"


class Silent:
    """Ideal joints whose encoders fall silent."""

    def __init__(self, live):
        self.live, self.q, self.measured, self.count = live, live.q, live.measured, 0

    def step(self, command):
        self.live.step(command)
        self.count += 1
        if self.count >= 50:
            self.measured[3] = np.nan


def test_encoders_that_fall_silent_halt_the_robot_softly(arm, circle):
    seen = []
    law = LAW.prepare(arm, circle, T)
    live = Silent(Integrator().start(arm, Q0, T, 301, 0))
    supervisor = Supervisor(ramp=0.0, acceleration=1.0).prepare(arm, T)
    supervision = Supervision(supervisor, Q0, watch=lambda *event: seen.append(event))
    trace = close_loop(law, live, circle.samples(T * np.arange(301)), supervision=supervision)
    assert trace.stopped.startswith("halted at 0.")
    assert trace.stopped.endswith("measurement stale or impossible")
    speeds = np.abs(trace.command).max(axis=1)
    assert (np.diff(speeds[50:]) < 0).all(), "braking from the first bad sample on"
    assert speeds[-1] == 0
    assert np.abs(np.diff(trace.command, axis=0)).max() <= 1.0 * T * (1 + 1e-9)
    assert seen[-1] == (pytest.approx(0.5), ("measurement stale or impossible",))


def test_a_spec_chooses_and_the_report_lists(tmp_path):
    spec = {
        "name": "guarded",
        "robot": "iiwa7",
        "start": Q0.tolist(),
        "period": T,
        "reference": {"kind": "circle", "radius": 0.05, "duration": 1.0},
        "law": {"kind": "proportional", "gain": 10},
        "plant": {"kind": "servo"},
        "supervisor": {"velocity": 0.05, "tracking_error": 1.0},
    }
    run = dqc.run(spec)
    assert np.abs(run.command).max() <= 0.05
    run.save(tmp_path / "out", figures=False)
    report = (tmp_path / "out" / "report.html").read_text()
    assert "Interventions of the supervisor" in report
    assert "velocity limit" in report
    loaded = dqc.recording.load_record(tmp_path / "out" / "record.mcap")
    assert np.array_equal(
        loaded.readings["interventions"].values, run.record.readings["interventions"].values
    )
    with pytest.raises(FileFormatError, match=r"supervisor.acceleration: expected a number > 0.0, got -1"):
        dqc.run(spec | {"supervisor": {"acceleration": -1.0}})


def test_before_which_plants_it_stands_by_default():
    base = {
        "name": "a", "robot": "iiwa7", "start": Q0.tolist(), "period": T, "reference": {"kind": "set-point"},
        "duration": 1.0, "law": {"kind": "proportional", "gain": 5},
    }  # fmt: skip
    simulator = {"kind": "coppeliasim", "joints": ["/joint"] * 7}
    for plant, key, expected in (
        ({"kind": "servo"}, {}, None),
        ({"kind": "servo"}, {"supervisor": True}, Supervisor()),
        ({"kind": "servo"}, {"supervisor": {"ramp": 1.0}}, Supervisor(ramp=1.0)),
        (simulator, {}, Supervisor()),
        (simulator, {"supervisor": False}, None),
        (simulator, {"supervisor": {"ramp": 1.0}}, Supervisor(ramp=1.0)),
    ):
        spec, _ = read_spec(base | {"plant": plant} | key)
        assert spec.supervisor_of(spec.plant) == expected
    with pytest.raises(FileFormatError, match="supervisor"):
        read_spec(base | {"plant": simulator, "supervisor": 3})


class Robot:
    """Ideal joints that move as they were last told, and remember what they were told; something may happen to them."""

    def __init__(self, happens=None):
        self.q, self.measured, self.told, self.happens = Q0.copy(), Q0.copy(), [], happens

    def step(self, command):
        self.told.append(command.copy())
        if self.happens and len(self.told) >= 60:
            self.happens(self)
        self.q = self.q + T * command
        self.measured = self.q.copy()


def lose(robot):
    raise OSError("the robot does not answer")


def interrupt(robot):
    if len(robot.told) in (60, 62):  # the second while it brakes
        signal.raise_signal(signal.SIGINT)


def slow(made):
    return lambda robot: made.work(0.03) if len(robot.told) == 60 else None


def failing_law(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    if sample[-1] > 0.6:
        raise ZeroDivisionError(repr(globals()))  # which does not compile: it is interpreted, and raises
    out[:] = 0.3 * np.cos(sample[-1])


class MadeTime:
    """A time that passes when somebody sleeps or works."""

    def __init__(self):
        self.seconds = 5.0

    def now(self):
        self.seconds += 1e-7
        return self.seconds

    def work(self, seconds):
        self.seconds += seconds


def ends_at_rest(robot, acceleration=2.0):
    """Return the last speed before it braked; it braked as it may, and rests."""
    told = np.array(robot.told)
    assert not told[-1].any(), told[-3:]
    assert np.abs(np.diff(told, axis=0, prepend=np.zeros((1, 7)))).max() <= acceleration * T * (1 + 1e-9)
    speed = np.abs(told).max(axis=1)
    return speed[np.flatnonzero(np.diff(speed) >= 0)[-1]]


def supervised(arm, supervisor=None):
    supervisor = supervisor or Supervisor(ramp=0.0, acceleration=2.0)
    return Supervision(supervisor.prepare(arm, T), Q0)


def test_whatever_ends_a_supervised_loop_the_robot_is_told_to_rest(arm, monkeypatch):
    fast = dqc.references.Circle(arm.fkm(Q0), radius=0.1, duration=1.5)
    samples = fast.samples(T * np.arange(100))
    law = LAW.prepare(arm, fast, T)

    def drive(robot, law=law, **options):
        watched = supervised(arm)
        return close_loop(law, robot, samples, supervision=watched, **options), watched

    robot = Robot()
    trace, _ = drive(robot)
    assert ends_at_rest(robot) > 0.1
    assert trace.stopped == "duration"
    assert len(trace.q) == len(trace.desired) == len(robot.told) > 100
    assert not trace.command[-1].any()
    assert (np.diff(trace.desired[:, -1]) > 0).all()
    assert not trace.desired[100:, 8:20].any(), "what is desired rests"

    robot = Robot(lose)
    with pytest.raises(OSError, match="does not answer"):
        drive(robot)
    assert ends_at_rest(robot) > 0.1
    assert len(robot.told) > 61, "it is told again, though it does not answer"

    robot = Robot()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it does not compile is said once only
        failing = dqc.laws.OwnLaw(function=failing_law).prepare(arm, fast, T)
    with pytest.raises(ZeroDivisionError):
        drive(robot, failing)
    assert ends_at_rest(robot) > 0.2

    robot = Robot(interrupt)
    with pytest.raises(KeyboardInterrupt):
        drive(robot)
    assert ends_at_rest(robot) > 0.1

    made = MadeTime()
    robot = Robot(slow(made))
    trace, _ = drive(robot, clock=Clock(made.now, made.work, overrun="stop"))
    assert ends_at_rest(robot) > 0.1
    assert trace.stopped.endswith("s: stop category 1: the work of a period took 20 ms too long")

    fault = property(lambda robot: "drives off" if len(robot.told) > 60 else "")
    monkeypatch.setattr(Robot, "fault", fault, raising=False)
    robot = Robot()
    trace, _ = drive(robot)
    assert ends_at_rest(robot) > 0.1
    assert trace.stopped == "faulted at 0.6 s: stop category 0: drives off"


def test_compiled_loops_end_at_rest_too_and_equally(arm):
    fast = dqc.references.Circle(arm.fkm(Q0), radius=0.1, duration=1.5)
    for duration, stop in ((1.0, None), (1.5, dqc.loop.Stop(error=1.0, samples=60))):
        runs = [
            dqc.simulate(
                arm, fast, LAW, Servo(encoder_noise=1e-5), Q0, T, duration, stop=stop, interpreted=interpreted,
                supervisor=Supervisor(ramp=0.0, acceleration=2.0),
            )
            for interpreted in (False, True)
        ]  # fmt: skip
        assert runs[0].stopped == runs[1].stopped == ("settled" if stop else "duration")
        for name in ("time", "q", "measured", "command", "desired"):
            assert np.array_equal(getattr(runs[0], name), getattr(runs[1], name)), name
        assert not runs[0].command[-1].any()
        assert np.abs(np.diff(runs[0].command, axis=0)).max() <= 2.0 * T * (1 + 1e-9)


@pytest.mark.parametrize("overrun", ["catch up", "skip"])
def test_a_frozen_loop_stops_instead_of_making_up_for_it(arm, overrun):
    """The process sleeps for 3 s of made time, as by SIGSTOP and SIGCONT."""
    made = MadeTime()
    robot = Robot(lambda robot: made.work(3.0) if len(robot.told) == 60 else None)
    fast = dqc.references.Circle(arm.fkm(Q0), radius=0.1, duration=8.0)
    watched = supervised(arm)
    trace = close_loop(
        LAW.prepare(arm, fast, T), robot, fast.samples(T * np.arange(700)),
        supervision=watched, clock=Clock(made.now, made.work, overrun=overrun),
    )  # fmt: skip
    assert trace.stopped.endswith("stop category 2: gap in time")
    assert 60 < len(trace.q) < 90
    ends_at_rest(robot)
    hands = dqc.algebra.translation(arm.fkm(trace.q))
    speeds = np.linalg.norm(np.diff(hands, axis=0), axis=1) / T
    assert speeds[60:].max() <= 1.1 * speeds[40:60].max()


@pytest.mark.slow
def test_the_black_box_holds_the_last_seconds_and_is_drawn(arm, tmp_path):
    fast = dqc.references.Circle(arm.fkm(Q0), radius=0.1, duration=40.0)
    spec = (
        "{name: box, robot: iiwa7, start: [0, 0.6, 0, 1.6, 0, 0.6, 0], period: 0.01, plant: {kind: integrator},"
        " reference: {kind: circle, radius: 0.1, duration: 40}, law: {kind: proportional-feedforward, gain: 10}}"
    )
    robot = Robot(lambda robot: setattr(robot, "q", np.full(7, np.nan)) if len(robot.told) > 2500 else None)
    watched = supervised(arm)
    trace = close_loop(
        LAW.prepare(arm, fast, T), robot, fast.samples(T * np.arange(4001)), supervision=watched
    )
    assert trace.stopped.endswith("measurement stale or impossible")
    folder = save_black_box(watched.black_box, tmp_path / "box", spec, trace.stopped)
    kept = dqc.recording.load_record(folder / "record.mcap")
    assert len(kept) == 2000
    assert np.array_equal(kept.command, trace.command[-2000:])
    assert kept.time[-1] == pytest.approx(trace.desired[-1, -1])
    assert kept.stopped == trace.stopped
    assert save_black_box(watched.black_box, tmp_path / "box", spec, trace.stopped).name == "box-2"
    figures(folder, formats=("png",), out=tmp_path / "figures")
    assert list((tmp_path / "figures").glob("*.png"))


def test_what_a_plant_does_not_measure_is_not_supervised_silently(arm, circle):
    for field in ("effort", "contact_effort", "contact_force", "contact_torque"):
        with pytest.raises(ValueRangeError, match=f"supervisor.{field}: CompiledPlant measures no"):
            dqc.simulate(arm, circle, LAW, Servo(), Q0, T, supervisor=Supervisor(**{field: 1.0}))


def test_a_robot_of_ones_own_may_measure_effort_wrench_and_age(arm, circle):
    for name, value, told in (
        ("effort", np.full(7, 60.0), "joint effort too large"),
        ("wrench", np.array([50.0, 0, 0, 0, 0, 0]), "contact"),
        ("age", 1.0, "measurement stale or impossible"),
    ):
        robot = Robot(lambda robot, name=name, value=value: setattr(robot, name, value))
        robot.effort, robot.wrench, robot.age = np.zeros(7), np.zeros(6), 0.0
        watched = supervised(arm, Supervisor(ramp=0.0, acceleration=2.0, effort=50.0, contact_force=30.0))
        trace = close_loop(
            LAW.prepare(arm, circle, T), robot, circle.samples(T * np.arange(300)), supervision=watched
        )
        assert trace.stopped.endswith(f"stop category 1: {told}")
        ends_at_rest(robot)
