"""The supervisor in the loop: compiled and interpreted alike, halts, signals, specs."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, ValueRangeError
from dqcontrol.experiments import read_spec
from dqcontrol.laws import ProportionalFeedforward
from dqcontrol.limits import Supervisor, list_interventions
from dqcontrol.loop import Supervision, close_loop
from dqcontrol.plants import Integrator, Servo

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
        assert runs[0].stopped.endswith("s: tracking error too large")
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
    assert guarded.q == pytest.approx(plain.q, abs=1e-12)
    assert not guarded.readings["interventions"].values.any()


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
    run.save(tmp_path / "out")
    report = (tmp_path / "out" / "report.html").read_text()
    assert "Interventions of the supervisor" in report
    assert "velocity limit" in report
    loaded = dqc.recording.load_record(tmp_path / "out" / "record.mcap")
    assert np.array_equal(
        loaded.readings["interventions"].values, run.record.readings["interventions"].values
    )
    with pytest.raises(ValueRangeError, match=r"supervisor.acceleration: must be > 0, got -1"):
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
