"""Quadratic programs: ours against DAQP, and a step of Pink and of Mink, which solve one with joint limits.

    python benchmarks/quadratic_programs.py [--short]

Ours are timed in the compiled solver, DAQP by its own timer, all in turns; answers are compared before. Peers that are
not installed have no row.
"""

from __future__ import annotations

import argparse
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio
from kinematics import PANDA, Q, as_mjcf
from measure import Ratio, medians, table

import dqcontrol as dqc
from dqcontrol.constraints import active_set
from dqcontrol.robots.files.load import package_files

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "constraints"))

GAIN, PERIOD = 10.0, 0.01


def by_pink(goal: np.ndarray) -> Any:
    """Return a function that makes a step towards a pose matrix (4 × 4)."""
    import pink

    full = pinocchio.buildModelFromUrdf(str(package_files("example-robot-data")[PANDA]))
    model = pinocchio.buildReducedModel(full, [8, 9], pinocchio.neutral(full))
    configuration = pink.Configuration(model, model.createData(), Q)
    task = pink.tasks.FrameTask("panda_hand", position_cost=1.0, orientation_cost=1.0, gain=GAIN * PERIOD)
    task.set_target(pinocchio.SE3(goal))

    def step() -> np.ndarray:
        configuration.update(Q)
        return pink.solve_ik(configuration, [task], PERIOD, solver="daqp")

    return step


def by_mink(goal: np.ndarray, arm: dqc.Robot) -> Any:
    """Return a function that makes a step towards a pose matrix (4 × 4)."""
    import mink

    model = mujoco.MjModel.from_xml_string(as_mjcf(arm, limited=True))
    configuration = mink.Configuration(model, Q)
    task = mink.FrameTask("hand", "body", position_cost=1.0, orientation_cost=1.0, gain=GAIN * PERIOD)
    task.set_target(mink.SE3.from_matrix(goal))

    def step() -> np.ndarray:
        configuration.update(Q)
        return mink.solve_ik(configuration, [task], PERIOD, solver="daqp")

    return step


def ratios(short: bool) -> list[Ratio]:
    """Return our step of law K with the damped inverse against theirs."""
    arm = dqc.load_robot(f"example-robot-data:{PANDA}", tip_link="panda_hand")
    pose = dqc.DualQuaternion(arm.fkm(Q + 0.02))
    goal, sample, out = np.asarray(pose.matrix()), dqc.Sample(pose.vec8), np.empty(7)
    law = dqc.laws.Proportional(gain=GAIN, inverse=dqc.laws.DampedInverse(damping=0.01))
    prepared = law.prepare(arm, None, PERIOD)
    state = prepared.initial_state(Q)
    ours = prepared.command(Q, sample, state).copy()
    functions: dict[str, Any] = {"ours": lambda: prepared.command(Q, sample, state, out)}
    if find_spec("pink"):
        functions["Pink, one step"] = by_pink(goal)
    if find_spec("mink"):
        functions["Mink, one step"] = by_mink(goal, arm)
    for name, function in functions.items():  # near the goal all go the same way, at nearly the same speed
        step = np.asarray(function())
        if not np.linalg.norm(step - ours) < 0.25 * np.linalg.norm(ours):
            raise SystemExit(f"{name}: differs, {step} against {ours}")
    t = medians(functions, 500, 3 if short else 15)
    return [
        Ratio("K, damped", t["ours"], "µs", f"{name} (a quadratic program)", t[name], "≤ 0.05")
        for name in functions
        if name != "ours"
    ]


class Programs:
    """Packed programs with as many rows, which the solver takes one after the other: cold, or from their own sets."""

    def __init__(self, flat: np.ndarray, n: int, m: int, *, soft: bool = False) -> None:
        self.flat, self.n, self.m = flat, n, m
        room = active_set.room_for(n, m, soft)
        self.answers = np.empty((len(flat), 3 * n + m))
        self._scratch = np.empty(active_set.scratch_size(n, m, room))
        self._empty, self._own = np.zeros((2, len(flat), room + 2), np.intp)
        self._solve(self._own)
        if (self._own[:, -1] != active_set.SOLVED).any():
            raise SystemExit("program: not solved")

    def _solve(self, sets: np.ndarray) -> None:
        active_set.solve_programs(self.flat, self.n, self.m, 500, self.answers, sets, self._scratch)

    def cold(self) -> None:
        """Solve all from no set."""
        self._empty[:, 0] = 0
        self._solve(self._empty)

    def warm(self) -> None:
        """Solve all from what is active in their answers."""
        self._solve(self._own)

    def by_daqp(self) -> np.ndarray:
        """Return the seconds that DAQP takes for each; stop if an answer of ours is not within 1e-9 of its own."""
        from program_samples import solve_by_daqp

        times = np.empty(len(self.flat))
        for i, each in enumerate(self.flat):
            u, times[i] = solve_by_daqp(each, self.n, self.m)
            if not np.abs(u - self.answers[i, : self.n]).max() < 1e-9:
                raise SystemExit(f"program of {self.n} inputs and {self.m} rows: differs from DAQP")
        return times


def against_daqp(groups: list[Programs], rounds: int) -> tuple[float, float, float]:
    """Return µs of a program, cold and warm, and by DAQP's own timer: taken in turns, of each the least."""
    count = sum(len(group.flat) for group in groups)
    ours, theirs = np.full(2, np.inf), np.full(count, np.inf)
    for _ in range(rounds):
        theirs = np.minimum(theirs, np.concatenate([group.by_daqp() for group in groups]))
        for k, solve in enumerate((Programs.cold, Programs.warm)):
            start = time.perf_counter()
            for group in groups:
                solve(group)
            ours[k] = min(ours[k], time.perf_counter() - start)
    return 1e6 * ours[0] / count, 1e6 * ours[1] / count, 1e6 * float(theirs.mean())


def compare(count: int) -> None:
    """Stop unless so many random programs, half of them with nearly dependent rows, have the answers of DAQP."""
    from program_samples import nearly_dependent_programs, random_programs

    rng, done = np.random.default_rng(7), 0
    for n in range(2, 15):
        for m in (5, 12, 25, 40):
            each = max(count // 104, 1)
            for flat in (
                random_programs(rng, each, n, m),
                nearly_dependent_programs(rng, each, n, m, 1e-6),
            ):
                Programs(flat, n, m).by_daqp()
                done += each
    print(f"{done} random programs, n = 2 … 14, up to 40 rows: within 1e-9 of DAQP")


def program_ratios(short: bool) -> list[Ratio]:
    """Return the programs of a Panda's loop among obstacles, and random ones with 40 rows, against DAQP."""
    from program_samples import programs_of_a_loop, random_programs

    if not find_spec("daqp"):
        return []
    compare(1000 if short else 100_000)
    by_rows: dict[int, list[np.ndarray]] = {}
    for flat, m in programs_of_a_loop(np.random.default_rng(9), 100 if short else 2000):
        by_rows.setdefault(m, []).append(flat)
    loop = [Programs(np.array(flats), 7, m) for m, flats in by_rows.items()]
    dense = [Programs(random_programs(np.random.default_rng(6), 400, 7, 40), 7, 40)]
    rounds = 5 if short else 25
    cold, warm, theirs = against_daqp(loop, rounds)
    cold_40, _, theirs_40 = against_daqp(dense, rounds)
    least, most = min(by_rows), max(by_rows)
    rows = f"program of a loop, n = 7, {least} … {most} rows"
    peer = "DAQP, its own timer"
    return [
        Ratio(f"{rows}, cold", cold, "µs", peer, theirs, "≤ 0.6"),
        Ratio(f"{rows}, warm", warm, "µs", peer, theirs, "≤ 0.5"),
        Ratio("random program, n = 7, 40 rows, cold", cold_40, "µs", peer, theirs_40, "≤ 1"),
    ]


def level_ratio(short: bool) -> Ratio:
    """Return three degenerate levels of 14 inputs against one program of the same rows, in which all give way."""
    from program_samples import degenerate_levels, packed_levels

    from dqcontrol.constraints.levels import levels_size, room_for_levels, solve_levels

    rng = np.random.default_rng(3)
    cases = [packed_levels(*degenerate_levels(rng), 3) for _ in range(100)]
    _, _, n, m = cases[0]
    soft = np.array([flat for flat, *_ in cases])
    for each in soft:
        active_set.unpack_program(each, n, m).softness[:] = 1e-4
    program = Programs(soft, n, m, soft=True)
    memory, chosen = np.empty(levels_size(n, m)), np.zeros(room_for_levels(n, m) + 2, np.intp)
    u = np.empty(n)

    def levels() -> None:
        for flat, level, *_ in cases:
            if solve_levels(flat, level, 3, n, m, 500, memory, u, chosen) != active_set.SOLVED:
                raise SystemExit("levels: not solved")

    t = medians({"levels": levels, "program": program.cold}, 10, 5 if short else 15)
    count = len(cases)
    return Ratio(
        "three degenerate levels, n = 14",
        t["levels"] / count,
        "µs",
        "one program of their rows",
        t["program"] / count,
        "≤ 3",
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--short", action="store_true")
    short = parser.parse_args().short
    print(table([*program_ratios(short), level_ratio(short)], "Quadratic programs").markdown())
