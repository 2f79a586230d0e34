"""One figure of each kind that we can draw, of small runs made here."""

import functools
import types

import numpy as np

import dqcontrol as dqc
from dqcontrol import figures as view
from dqcontrol.figures import parity
from dqcontrol.films.light_painting import light_painting, light_paintings
from dqcontrol.laws import FeedbackLinearization
from dqcontrol.loop import Timing
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.measures.lyapunov import certificate
from dqcontrol.measures.task_range import task_range
from dqcontrol.robots.limits import symmetric_limits

print("seed 8")
RNG = np.random.default_rng(8)
NAMES = (  # known without a run: tests have parameters before they run
    *("path", "path-in-space", "paths", "errors", "errors-of-many", "pose", "joints"),
    *("margins", "inputs", "disturbance", "readings", "criteria", "base", "motion"),
    *("poses", "compared-joints", "compared-inputs", "range", "lyapunov", "timing", "histogram"),
    *("repeats", "gains", "sweep", "surface", "parity", "painting", "paintings"),
    *("criteria-in-columns", "repeats-of-many"),
)


def shifted(points):
    points = np.asarray(points, float)
    return np.hstack([np.tile([1.0, 0, 0, 0, 0], (len(points), 1)), points / 2])


def run(lag=0.01, joints=7, count=300, pitch=0.0):
    """A hand that follows a circle, or a spiral with a pitch (m a turn)."""
    time = np.linspace(0, 4, count)
    turn = np.pi * time / 2
    desired = 0.1 * np.column_stack([np.cos(turn), pitch * turn / 0.628, np.sin(turn)]) + [0.5, 0, 0.4]
    pose = shifted(desired + lag * np.exp(-time)[:, None] * [1.0, 0.5, -1.0])
    q = np.sin(time[:, None] + np.arange(joints)) * np.linspace(0.3, 1.5, joints)
    force = Signal("contact_force", ("ball", "table", "itself"), ("N",) * 3, 5 * RNG.normal(size=(count, 3)))
    load = Signal("payload", (), ("kg",), np.full((count, 1), 0.5))
    return Record(
        time,
        q,
        q,
        np.gradient(q, time, axis=0),
        pose,
        np.hstack([shifted(desired), np.zeros((count, 13))]),
        tuple(f"panda_joint{i + 1}" for i in range(joints)),
        disturbance=0.01 * RNG.normal(size=(count, 6)),
        readings={"contact_force": force, "payload": load},
    )


def rows(laws=("K", "LQR-DQ", "HIR"), sets=("slow", "fast"), repeats=8):
    return [
        {
            "robot": "iiwa7",
            "law": law,
            "set": name,
            "plant": "servo",
            "seed": k,
            "repeat": k,
            "stopped": "duration",
        }
        | {"error.integral": (1 + i) * (2 - j) * RNG.normal(0.1, 0.004), "parameter.gain": 5.0 * (j + 1)}
        for i, law in enumerate(laws)
        for j, name in enumerate(sets)
        for k in range(repeats)
    ]


class Ranked:
    """A ranking of a parameter study, as `sweep_figure` takes it."""

    by, placed = "error.integral", 200
    varied = (
        "law",
        "parameter.laws.*.gain",
        "parameter.plant.time_constant",
        "parameter.plant.encoder_noise",
    )
    groups = types.SimpleNamespace(column_names=varied)

    def __init__(self):
        gain, lag, noise = 10 ** RNG.uniform([0, -2, -5], [2, -1, -3], (self.placed, 3)).T
        error = np.sort(0.1 / gain + 0.01 * lag)
        self.columns = dict(
            zip(self.varied, (RNG.choice(["K", "K+FF"], self.placed), gain, lag, noise), strict=True)
        )
        self.columns["error.integral"] = error

    def column(self, name):
        return self.columns[name]


@functools.cache
def figures():
    """Return what draws each kind of figure, by name."""
    one, spiral = run(), run(pitch=0.1)
    some = {
        label: run(lag, joints=3)
        for label, lag in (("K · servo", 0.01), ("K+FF · servo", 0.004), ("LQR", 0.02))
    }
    many = {f"gain {i}": run(0.001 * (i + 1), joints=3) for i in range(12)}
    limits = symmetric_limits([2.9, 1.5, 2.9, 2.0, 2.9, 2.0, 2.9], [2.0] * 7, [100.0] * 7)
    units = ["m", "m", "rad", "rad", "rad", "rad", "rad"]
    body, start = dqc.load_robot("little-john"), np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    goal = dqc.references.SetPoint(body.fkm(start + np.array([0.6, 0.3, 0.5, 0.2, 0, 0, 0, 0])))
    law = FeedbackLinearization(stiffness=0.6, damping=1.0)
    drive = dqc.simulate(body, goal, law, dqc.plants.Integrator(), start, 0.05, 6.0)
    pair = {"nonlinear": drive, "classic": drive}
    begin = 0.008 * np.arange(500) + RNG.uniform(0, 1e-4, 500)
    timing = Timing(0.008, begin, RNG.uniform(2e-4, 3e-4, 500), np.full(500, 0.0077), np.arange(500) == 5)
    q, r = np.array([1, 10, 20, 40, 70.0]), np.array([0.05, 0.5, 5, 100.0])
    bowl = np.add.outer(q / 70, np.log10(r))
    errors = RNG.lognormal(0, 1, (5, 2))
    pairs = {
        law: [tuple(row) for row in errors * [1, 1 + 0.1 * k]] for k, law in enumerate(("K", "HIR", "LQR"))
    }
    panels = dict.fromkeys(("Err", "θ̇ [rad]", "Eff [rad s]", "L.Vel [m]", "L.Acc [m/s]"), pairs)
    return {
        "path": lambda: view.path_3d(one),
        "path-in-space": lambda: view.path_3d(spiral),
        "paths": lambda: view.compare_paths(some),
        "errors": lambda: view.errors(one),
        "errors-of-many": lambda: view.compare_errors(many),
        "pose": lambda: view.pose_coefficients(one),
        "joints": lambda: view.joint_angles(one, limits, ["rad"] * 7),
        "margins": lambda: view.limit_margins(one, limits),
        "inputs": lambda: view.control_signals(one, units),
        "disturbance": lambda: view.disturbance(one),
        "readings": lambda: view.readings(one),
        "criteria": lambda: view.compare_criteria(some),
        "base": lambda: view.base_path(body, pair),
        "motion": lambda: view.superimposed(body, pair),
        "poses": lambda: view.compare_poses(pair),
        "compared-joints": lambda: view.compare_joints(pair, body.limits, (4, 5, 6), (1.0, 2.0)),
        "compared-inputs": lambda: view.compare_inputs(
            {"nonlinear": (one.time, one.command), "classic": (one.time, 0.5 * one.command)},
            [f"joint {i} [rad/s]" for i in range(7)],
        ),
        "range": lambda: view.range_condition(task_range(body, drive), drive.error),
        "lyapunov": lambda: view.lyapunov(certificate(body, drive, law)),
        "timing": lambda: view.timing_histogram(timing),
        "histogram": lambda: view.histogram({name: RNG.normal(8, 0.1, 400) for name in "abc"}),
        "repeats": lambda: view.repeats_figure(rows()),
        "gains": lambda: view.gain_figure(rows(), "parameter.gain"),
        "sweep": lambda: view.sweep_figure(Ranked()),
        "surface": lambda: view.surface(
            q, r, {"Eff [rad s]": bowl, "L.Vel [m]": bowl**2, "log₁₀ Err": -bowl}
        ),
        "parity": lambda: parity(panels),
        "painting": lambda: light_painting(one),
        "paintings": lambda: light_paintings(some, dict.fromkeys(some)),
        "criteria-in-columns": lambda: view.criteria_side_by_side({"20 %": one, "100 %": one}, "rad"),
        "repeats-of-many": lambda: view.repeats_figure(rows("ABCDEFG", ("ln2²", "ln2", "best"))),
    }
