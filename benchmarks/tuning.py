"""What a search costs, how good its fronts and winners are, and how far learning goes: the figures of docs/tune.md.

`python benchmarks/tuning.py cost | fronts | winners | learning | physics | online`; without a word all of them, some
minutes. pymoo and Optuna are compared with where they are installed (`pip install pymoo optuna`).
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import dqcontrol as dqc
from dqcontrol.experiments import check
from dqcontrol.experiments.feasibility import path_demand
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.files.output_file import yaml_text
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.loop.simulate import simulate_prepared
from dqcontrol.measures.metrics import AT_LIMIT
from dqcontrol.references import Previewed
from dqcontrol.tuning import hypervolume, nondominated, search_front
from dqcontrol.tuning.law_search import LawSearch, ready_problem
from dqcontrol.tuning.searches import SimplexSearch
from dqcontrol.tuning.spec_blocks import Front, read_tune

START = [0, 0.6, 0, 1.6, 0, 0.6, 0]
CIRCLE = {"kind": "circle", "radius": 0.06, "duration": 4, "ramp": 0.5}
SERVO = {"kind": "servo", "time_constant": 0.05, "delay": 0.02, "sag": 0.5, "encoder_noise": 5e-4}
BASE: dict[str, Any] = {
    "name": "bench",
    "robot": "iiwa7",
    "start": START,
    "period": 0.01,
    "reference": CIRCLE,
    "law": {"kind": "proportional-feedforward", "gain": 5, "integral_gain": 2},
    "plant": SERVO,
}
SQUARE = {"kind": "square", "side": 0.06, "duration": 3, "corner_stops": 0.3}
OTHERS = 400  # evaluations of NSGA-II
RUNS = 8  # of an evaluation whose cost is measured
AWAY = 0.15  # rad, as far are other starts
LARGEST = 0.07  # m, radius of the circles that are searched on


def cost() -> None:
    """Overhead of a search beside its evaluations, and of these beside their rollouts, on two cores at once."""
    with ProcessPoolExecutor(2, get_context("spawn")) as cores:
        costs = np.mean(list(cores.map(_cost_on_a_core, range(2))), axis=0)
    alone, among, whole, with_numbers, bare = costs
    print(
        f"overhead of the search: {alone:.3f} ms an evaluation by itself (≤ 0.1 wanted), {among:.3f} between rollouts, "
        f"which empty the caches; an evaluation of {RUNS} runs: {whole:.2f} ms; its rollouts with their numbers "
        f"{with_numbers:.2f} ms: {with_numbers / whole:.3f} of their throughput (≥ 0.9 wanted); the loops without "
        f"numbers {bare:.2f} ms: {bare / whole:.3f}"
    )


def _cost_on_a_core(seed: int) -> tuple[float, float, float, float, float]:
    """Run a search and, before each of its evaluations, the same rollouts by themselves, in one loop.

    Returns the search's mean overhead when it is told what it found, and when it has to run it; and medians of an
    evaluation, of its rollouts with and without numbers: ms of the thread's processor time, on which programs beside
    it have the least influence.
    """
    warnings.simplefilter("ignore")
    problem = read_tune(
        BASE | {"seed": seed, "reference": CIRCLE | {"duration": 12}},
        budget=300,
        references=[{"kind": "square", "side": 0.08, "duration": 12, "corner_stops": 0.3}],
        seeds=RUNS // 2,
    )
    evaluation = ready_problem(problem).searched
    loops = [loop for loops in evaluation._loops for loop in loops]
    found = LawSearch(problem, "proportional-feedforward")
    overheads: list[float] = []
    times: list[tuple[float, float, float]] = []

    def evaluated(point: tuple[float, ...]) -> Any:
        nonlocal left
        begun = time.thread_time()
        overheads.append(begun - left)
        prepared, bare, numbers = evaluation.prepared(found.space.law_at(point)), 0.0, 0.0
        for i, loop in enumerate(loops):
            scene = i % len(evaluation._scenes)
            begun = time.thread_time()
            passed = loop.run(prepared[scene])
            between = time.thread_time()
            evaluation._measures[scene](passed.samples, passed.q, passed.command, 0)
            bare, numbers = bare + between - begun, numbers + time.thread_time() - between
        found.space._known.clear()  # a search asks for no point twice
        begun = time.thread_time()
        result = LawSearch._evaluated(found, point)
        left = time.thread_time()
        times.append((left - begun, bare + numbers, bare))
        return result

    SimplexSearch(lambda point: (0.0, sum(point)), 2, 40, seed=0).run()  # loads what SciPy loads once
    found._evaluated = evaluated
    left = time.thread_time()
    found.search()
    begun = time.thread_time()
    found.search()  # of points that it knows
    alone = (time.thread_time() - begun) / len(overheads)
    return 1e3 * alone, 1e3 * float(np.mean(overheads)), *(1e3 * np.median(times, axis=0)).tolist()


def front_problems() -> Iterator[tuple[str, dict[str, Any], dict[str, Any], tuple[str, str]]]:
    """Give five problems: law, what is free, and both objectives."""
    law = BASE["law"]
    wide = {"loop_gain": {"low": 0.005, "high": 0.2}, "integral_share": {"low": 0.005, "high": 0.2}}
    errors = ("position.rms", "command_jerk")
    yield "K+FF+I, error and jerk", {"law": law}, wide, errors
    yield "K+FF+I, peak and jerk", {"law": law}, wide, ("position.peak", "command_jerk")
    yield (
        "HIRT, position and orientation",
        {"law": {"kind": "h-infinity-tracking", "orientation_gain": 10, "translation_gain": 5}},
        {"orientation_gain": {"low": 2, "high": 40}, "translation_gain": {"low": 1, "high": 20}},
        ("position.rms", "command_jerk"),
    )
    yield (
        "K+I late, error and hand's acceleration",
        {"law": {"kind": "proportional", "gain": 5, "integral_gain": 2}, "plant": SERVO | {"delay": 0.04}},
        {"loop_gain": {"low": 0.005, "high": 0.15}, "integral_share": {"low": 0.005, "high": 0.2}},
        ("position.rms", "hand_acceleration.rms"),
    )
    yield (
        "K+FF with threshold, error and jerk",
        {"law": {"kind": "proportional-feedforward", "gain": 5}},
        {"loop_gain": {"low": 0.005, "high": 0.2}, "inverse.threshold": {"low": 1e-3, "high": 0.3}},
        errors,
    )


def fronts() -> None:
    """Hypervolume and wall time beside NSGA-II of pymoo and Optuna: one run each, ours with its default budget."""
    for method in (_pymoo, _optuna, _ours):
        method(lambda point: (point[0], 1 - point[0] + point[1]), 2)  # loads each one's libraries
    for label, changes, free, objectives in front_problems():
        (kind,) = [changes["law"]["kind"]]
        problem = read_tune(BASE | changes, free={kind: free}, front={"objectives": list(objectives)})
        search = LawSearch(problem, kind)
        size = len(search.space.names)

        def pair(
            point: tuple[float, ...], search=search, objectives=objectives
        ) -> tuple[float, float] | None:
            found = search._evaluate(search.space.law_at(point))
            return None if found.violation else (found.value(objectives[0]), found.value(objectives[1]))

        pair((0.5,) * size)
        found = {}
        for name, method in (("pymoo", _pymoo), ("Optuna", _optuna), ("ours", _ours)):
            begun = time.perf_counter(), time.process_time()
            points = method(pair, size)
            if points is not None:
                found[name] = points, time.perf_counter() - begun[0], time.process_time() - begun[1]
        every = np.log(np.vstack([np.array(points) for points, *_ in found.values()]))
        front = every[nondominated(every)]
        corner = tuple(front.max(axis=0) + 0.1 * np.ptp(front, axis=0))
        volumes = {name: hypervolume(np.log(points), corner) for name, (points, *_) in found.items()}
        shown = "; ".join(
            f"{name} {volumes[name]:.4g} in {1e3 * seconds:.0f} ms ({len(points)} points)"
            for name, (points, seconds, _) in found.items()
        )
        others = [name for name in found if name != "ours"]
        if others:
            share = volumes["ours"] / max(volumes[name] for name in others)
            wall, processor = (found["ours"][i] / min(found[name][i] for name in others) for i in (1, 2))
            shown += (
                f": {share:.3f} of the best volume (≥ 0.98 wanted) in {wall:.2f} of the shortest time (≤ 0.25 wanted), "
                f"{processor:.2f} of the processor's"
            )
        print(f"{label}: {shown}")


Pair = Callable[[tuple[float, ...]], "tuple[float, float] | None"]


def _ours(pair: Pair, size: int) -> list[tuple[float, float]]:
    return list(search_front(pair, size, Front(objectives=["", ""]).budget, seed=0).values())


def _pymoo(pair: Pair, size: int) -> list[tuple[float, float]] | None:
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2  # pyright: ignore[reportMissingImports]
        from pymoo.core.problem import ElementwiseProblem  # pyright: ignore[reportMissingImports]
        from pymoo.optimize import minimize  # pyright: ignore[reportMissingImports]
    except ImportError:
        return None
    seen: list[tuple[float, float]] = []

    class Front(ElementwiseProblem):
        def __init__(self) -> None:
            super().__init__(n_var=size, n_obj=2, xl=np.zeros(size), xu=np.ones(size))

        def _evaluate(self, x, out, *_, **__) -> None:
            values = pair(tuple(map(float, x)))
            if values is not None:
                seen.append(values)
            out["F"] = (1e6, 1e6) if values is None else values

    minimize(Front(), NSGA2(pop_size=40), ("n_eval", OTHERS), seed=1)
    return seen


def _optuna(pair: Pair, size: int) -> list[tuple[float, float]] | None:
    try:
        import optuna  # pyright: ignore[reportMissingImports]
    except ImportError:
        return None
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    seen: list[tuple[float, float]] = []

    def objective(trial) -> tuple[float, float]:
        values = pair(tuple(trial.suggest_float(f"z{i}", 0, 1) for i in range(size)))
        if values is not None:
            seen.append(values)
        return values or (1e6, 1e6)

    sampler = optuna.samplers.NSGAIISampler(population_size=40, seed=1)
    optuna.create_study(directions=["minimize", "minimize"], sampler=sampler).optimize(
        objective, n_trials=OTHERS
    )
    return seen


def winners(count: int = 50) -> None:
    """Random plants and laws: is any winner unstable, and how much worse is it on what was not searched?

    Searched on a circle and a square in a vertical plane from three starts. Judged twice: on both in a horizontal plane
    from two other starts with other noise, and on what `dqcontrol tune` holds out by itself. All starts leave the
    joints room: where one stops at the end of its range, errors say where that end is, and nothing of the law.
    """
    draw, ratios, unstable = np.random.default_rng(20261122), [], 0
    starts = [start for start, _ in zip(_roomy_starts(draw), range(4), strict=False)]
    laws = [
        {"kind": "proportional", "gain": 5},
        {"kind": "proportional-feedforward", "gain": 5},
        {"kind": "proportional-feedforward", "gain": 5, "integral_gain": 2},
        {"kind": "h-infinity-tracking", "orientation_gain": 10, "translation_gain": 5},
        {"kind": "decoupled-proportional", "gain": 5},
    ]
    for i in range(count):
        period = float(draw.choice([0.005, 0.008, 0.01]))
        plant = {
            "kind": "servo",
            "time_constant": float(np.exp(draw.uniform(np.log(0.02), np.log(0.15)))),
            "delay": float(draw.uniform(0, 0.05)),
            "sag": float(draw.uniform(0, 1)),
            "encoder_noise": float(np.exp(draw.uniform(np.log(5e-5), np.log(1e-3)))),
        }
        spec = BASE | {
            "period": period,
            "plant": plant,
            "law": laws[i % len(laws)],
            "reference": CIRCLE | {"radius": float(draw.uniform(0.03, LARGEST)), "duration": 3},
        }
        searched = {"budget": 24, "references": [SQUARE], "starts": starts[:2]}
        other_plane = [each | {"plane": "xy"} for each in (spec["reference"], SQUARE)]
        found = dqc.tune(spec, jobs=1, **searched, held_out={"references": other_plane, "starts": starts[2:]})
        best = found.best.result
        nearby = read_tune(spec | {"law": best.law}, **searched)
        (winner,) = nearby.spec.variants
        errors = [
            best.held_out["position.rms"],
            ready_problem(nearby).held_out(winner.law).value("position.rms"),
        ]
        (row,) = check(found.best_spec)
        failed = row.verdict == "unstable" or not np.isfinite(best.held_out_total)
        unstable += failed or row.worst.margin < 2
        ratios.append([error / best.searched["position.rms"] for error in errors])
    print(
        f"{count} tunings: {unstable} unstable or short of their margin; error held out over error searched "
        "(≤ 1.1 wanted):"
    )
    for label, column in zip(("in another plane", "by default"), np.transpose(ratios), strict=True):
        print(
            f"  {label}: median {np.median(column):.3f}, smallest {min(column):.3f}, largest {max(column):.3f}, "
            f"{np.sum(column > 1.1)} above 1.1"
        )


def _roomy_starts(draw: np.random.Generator) -> Iterator[list[float]]:
    """Give random starts from which no joint comes to its position limit on any of the motions."""
    motions = [
        each | {"plane": plane} for each in (CIRCLE | {"radius": LARGEST}, SQUARE) for plane in ("xz", "xy")
    ]
    while True:
        start = (START + draw.uniform(-AWAY, AWAY, len(START))).tolist()
        demands = [
            path_demand(prepare(BASE | {"start": start, "reference": each}).cases[0].scene)
            for each in motions
        ]
        if all(demand is not None and demand.limit_margin > AT_LIMIT for demand in demands):
            yield start


def learning(after: int = 20) -> None:
    """Servos with 50 ms lag, 20 ms delay, sag and 0.5 mrad of noise: four repeats, more of them, and replays."""
    plant = SERVO | {"sag": 1}
    for kind, wanted in (("proportional", 30), ("proportional-feedforward", 10)):
        spec = BASE | {"plant": plant, "law": {"kind": kind, "gain": 5}}
        found = dqc.learn(spec, repeats=4)
        errors = [each.position for each in found.repeats]
        more = [each.position for each in dqc.learn(spec, repeats=4 + after).repeats]
        clean = dqc.learn(spec | {"plant": plant | {"encoder_noise": 0}}, repeats=4)
        noise, replays = (_replayed(spec, each, range(100, 100 + after)) for each in (clean, found))
        print(
            f"learning, {kind}: {_in_short(found)} mm: 1/{errors[0] / errors[4]:.3g} (1/{wanted} wanted); "
            f"without noise {_in_short(clean)}\n"
            f"  {after} more repeats: at most {max(more[5:]) / min(errors):.3f} × the best of these (≤ 1.2 wanted), "
            f"the last {more[-1]:.3g} mm\n"
            f"  {after} runs of what was learnt in four: {np.mean(replays):.3g} mm, at most "
            f"{max(replays) / min(errors):.3f} × the best; of a motion learnt without noise {np.mean(noise):.3g} mm, "
            f"the largest {max(noise) / min(noise):.3f} × the smallest"
        )


def _in_short(found: dqc.tuning.Learning) -> str:
    return ", ".join(f"{each.position:.3g}" for each in found.repeats)


def _replayed(spec: dict[str, Any], found: dqc.tuning.Learning, seeds: range) -> list[float]:
    """Return the errors of a learnt motion with other noise, mm."""
    setting = prepare(spec)
    (case,) = setting.cases
    asked, motion = case.scene.reference, found.motion
    if isinstance(asked, Previewed):
        motion = Previewed(motion, asked.delay, asked.lag, asked.step)
    law, samples, errors = case.prepare_law(setting.spec), case.scene.along(motion).samples, []
    for seed in seeds:
        record = simulate_prepared(law, case.plant, setting.scene.start, samples, seed=seed)
        ways = np.linalg.norm(record.position - found.first.desired_position, axis=1)
        errors.append(1e3 * float(np.sqrt(np.mean(ways**2))))
    return errors


def physics() -> None:
    """Learning on the compliant arm with a tracker, and on joints of 3 Hz in MuJoCo; each from a circle in 6 s."""
    slow = CIRCLE | {"duration": 6}
    soft = {
        "robot": "meka-a2",
        "start": [0, 0.6283185, 0, 1.5707963, 0, 0.6283185, 0],
        "period": 0.008,
        "reference": slow | {"plane": "xy"},
        "plant": {"kind": "compliant"},
        "learn": {"repeats": 5, "measured_by": "tracker"},
    }
    heavy = {"reference": slow, "plant": {"kind": "mujoco", "bandwidth": 3.0}, "learn": {"repeats": 4}}
    for name, changes, kind, gain in (
        ("compliant Meka with a tracker", soft, "proportional", 3),
        ("compliant Meka with a tracker", soft, "proportional-feedforward", 3),
        ("MuJoCo, 3 Hz", heavy, "proportional-feedforward", 5),
    ):
        found = dqc.learn(BASE | changes | {"law": {"kind": kind, "gain": gain}})
        print(
            f"learning, {name}, {kind}: {_in_short(found)} mm: 1/{found.gain:.3g} (1/5 wanted of the compliant arm)"
        )


def online() -> None:
    """K+FF on a circle with what is known of the joints, and along corners with what `identify` finds of them."""
    _known_joints()
    _identified_joints()


def _known_joints() -> None:
    known = {"lag": 0.05, "delay": 0.02}
    plain = BASE | {
        "plant": {"kind": "servo", "time_constant": 0.05, "delay": 0.02, "sag": 1},
        "law": {"kind": "proportional-feedforward", "gain": 5, "feedforward": "printed"},
        "skip_initial": 0.5,
    }
    ahead = plain | {"law": {"kind": "proportional-feedforward", "gain": 5}}
    sag = {"compliance": 2e-3}
    runs = {
        "as printed": plain,
        "second order, with preview": ahead,
        "the same and sag": _compensated(ahead, **sag),
        "sag 30 % too small": _compensated(ahead, compliance=0.7 * sag["compliance"]),
        "too large": _compensated(ahead, compliance=1.3 * sag["compliance"]),
        "second order, with preview and observer": _compensated(ahead, observer=0.05, **known),
    }
    errors = {name: dqc.run(each).metrics.position.settled_rms for name, each in runs.items()}
    print("K+FF on a circle: " + ", ".join(f"{name} {error:.2g} mm" for name, error in errors.items()))
    late = plain | {"plant": plain["plant"] | {"delay": 0.12}}
    loops = {"none": late} | {
        f"{1e3 * time:.0f} ms": _compensated(late, observer=time, **known) for time in (0.05, 0.2)
    }
    rows = {name: check(each)[0] for name, each in loops.items()}
    print(
        "margin with 100 ms more delay than the observer's model: "
        + ", ".join(f"observer {name} {row.worst.margin:.3g}" for name, row in rows.items())
    )


def _compensated(spec: dict[str, Any], **how: Any) -> dict[str, Any]:
    return spec | {"limits": {"compensation": how}}


def _identified_joints() -> None:
    spec = BASE | {
        "plant": SERVO | {"sag": 1, "encoder_noise": 2e-4},
        "law": {"kind": "proportional-feedforward", "gain": 5, "feedforward": "printed"},
        "reference": {"kind": "square", "side": 0.08, "duration": 8},
    }
    with TemporaryDirectory() as folder:
        dqc.excite("iiwa7", START, duration=60, period=0.01, amplitude=0.3).save(f"{folder}/excite")
        path = Path(folder, "excite", "excite.yaml")
        motion = parse_yaml(str(path), path.read_text(encoding="utf-8"))
        path.write_text(yaml_text(motion | {"plant": spec["plant"]}), encoding="utf-8")
        dqc.run(path).save(f"{folder}/log")
        servo = dqc.identify(f"{folder}/log/record.mcap", "iiwa7").plant()
    lag, delay = float(np.mean(servo.time_constant)), float(np.mean(servo.delay))
    compliance = (np.asarray(servo.sag) / np.asarray(servo.stiffness)).tolist()
    preview = {"preview": {"delay": delay + 0.5 * BASE["period"], "lag": lag}}
    second = {"kind": "proportional-feedforward", "gain": 5}
    ahead = spec | {"law": second, "reference": spec["reference"] | preview}
    runs = {
        "as printed": spec,
        "second order, with preview": ahead,
        "the same and sag": _compensated(ahead, compliance=compliance),
    }
    errors = {name: dqc.run(each).metrics.position.rms for name, each in runs.items()}
    first, *_, last = errors.values()
    print(
        f"K+FF along a square, servos identified with lag {1e3 * lag:.3g} ms and delay {1e3 * delay:.3g} ms: "
        + ", ".join(f"{name} {error:.3g} mm" for name, error in errors.items())
        + f": {last / first:.3f} of the first (≤ 0.5 wanted)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    tasks = {
        "cost": cost,
        "fronts": fronts,
        "winners": winners,
        "learning": learning,
        "physics": physics,
        "online": online,
    }
    parser.add_argument("task", nargs="*", choices=[*tasks, []])
    chosen = parser.parse_args().task or list(tasks)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in chosen:
            tasks[name]()


if __name__ == "__main__":
    main()
