"""What a search costs, how good its fronts and winners are, and how far learning goes: the figures of docs/tune.md.

`python benchmarks/tuning.py cost | fronts | winners | learning`; without a word all of them, some minutes on one core.
pymoo and Optuna are compared with where they are installed (`pip install pymoo optuna`).
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np

import dqcontrol as dqc
from dqcontrol.experiments import check
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.loop.simulate import simulate_prepared
from dqcontrol.tuning import hypervolume, nondominated, search_front
from dqcontrol.tuning.law_search import LawSearch, ready_problem
from dqcontrol.tuning.simplex_search import SimplexSearch
from dqcontrol.tuning.tune_spec import read_tune

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
OTHERS, SHARE = 400, 0.22  # evaluations of NSGA-II; of the shorter of their times, when ours is stopped
SEEDS = 1


def cost() -> None:
    """Overhead of the search beside its evaluations, and evaluations beside bare rollouts."""
    problem = read_tune(
        BASE | {"reference": CIRCLE | {"duration": 12}},
        budget=300,
        references=[{"kind": "square", "side": 0.08, "duration": 12, "corner_stops": 0.3}],
        seeds=4,
    )
    ready, law = ready_problem(problem), LawSearch(problem, "proportional-feedforward")
    SimplexSearch(lambda point: (0.0, sum(point)), 2, 40, seed=0).run()  # imports SciPy
    begun = time.process_time()
    spent = [0.0]

    def rank(point: tuple[float, ...]) -> tuple[float, float]:
        start = time.process_time()
        found = law._evaluate(law.space.law_at(point))
        spent[0] += time.process_time() - start
        return found.rank

    search = SimplexSearch(rank, len(law.space.names), 300, seed=0)
    search.run()
    whole = time.process_time() - begun
    overhead = 1e3 * (whole - spent[0]) / len(search.points)
    prepared = ready.searched.prepared(law.space.law_at(search.best))
    loops = [loop for loops in ready.searched._loops for loop in loops]

    def rollouts() -> None:
        for i, loop in enumerate(loops):
            loop.run(prepared[i % len(ready.scenes)])

    def evaluated() -> None:
        law._evaluate(law.space.law_at(search.best))

    def simulated() -> None:
        for i, scene in enumerate(ready.scenes):
            simulate_prepared(prepared[i], loops[0].plant, scene.start, scene.samples)

    bare, all_of_it, ordinary = (
        min(_timed(each) for _ in range(30)) for each in (rollouts, evaluated, simulated)
    )
    ordinary *= len(loops) / len(ready.scenes)
    print(f"overhead of the search: {overhead:.3f} ms an evaluation of {len(loops)} runs (≤ 0.1 wanted)")
    print(
        f"an evaluation: {1e3 * all_of_it:.2f} ms; its bare rollouts {1e3 * bare:.2f} ms: "
        f"{bare / all_of_it:.2f} of their throughput; as ordinary runs without metrics {1e3 * ordinary:.2f} ms"
    )


def _timed(function: Callable[[], object]) -> float:
    begun = time.process_time()
    function()
    return time.process_time() - begun


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
    """Hypervolume and time beside NSGA-II of pymoo and Optuna, on the same evaluations."""
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
            seconds = SHARE * min((seconds for _, seconds in found.values()), default=1.0)
            begun = time.process_time()
            points = method(pair, size, begun + seconds)
            if points is not None:
                found[name] = points, time.process_time() - begun
        every = np.log(np.vstack([np.array(points) for points, _ in found.values()]))
        front = every[nondominated(every)]
        corner = tuple(front.max(axis=0) + 0.1 * np.ptp(front, axis=0))
        volumes = {name: hypervolume(np.log(points), corner) for name, (points, _) in found.items()}
        shown = "; ".join(
            f"{name} {volumes[name]:.4g} in {1e3 * seconds:.0f} ms ({len(points)} points)"
            for name, (points, seconds) in found.items()
        )
        others = [name for name in found if name != "ours"]
        if others:
            share = volumes["ours"] / max(volumes[name] for name in others)
            pace = found["ours"][1] / min(found[name][1] for name in others)
            shown += f": {share:.3f} of the best volume in {pace:.2f} of the shortest time"
        print(f"{label}: {shown}")


Pair = Callable[[tuple[float, ...]], "tuple[float, float] | None"]


def _ours(pair: Pair, size: int, until: float) -> list[tuple[float, float]]:
    """Search until a moment of the processor's time; until all evaluations of the others are used at most."""
    seen: list[tuple[float, float]] = []

    def timed(point: tuple[float, ...]) -> tuple[float, float] | None:
        if time.process_time() > until:
            raise TimeoutError
        values = pair(point)
        if values is not None:
            seen.append(values)
        return values

    with suppress(TimeoutError):
        search_front(timed, size, OTHERS, seed=0)
    return seen


def _pymoo(pair: Pair, size: int, _: float) -> list[tuple[float, float]] | None:
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


def _optuna(pair: Pair, size: int, _: float) -> list[tuple[float, float]] | None:
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
    """Random plants and laws: is any winner unstable, and how much worse is it on what was not searched?"""
    draw, ratios, unstable = np.random.default_rng(20261122), [], 0
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
            "reference": CIRCLE | {"radius": float(draw.uniform(0.03, 0.07)), "duration": 3},
        }
        found = dqc.tune(
            spec,
            jobs=1,
            budget=24,
            references=[SQUARE],
            held_out={"references": [{"plane": "xz"} | each for each in (spec["reference"], SQUARE)]},
        )
        (row,) = check(found.best_spec)
        failed = row.verdict == "unstable" or not np.isfinite(found.best.result.held_out_total)
        unstable += failed or row.worst.margin < 2
        ratios.append(found.best.result.held_out["position.rms"] / found.best.result.searched["position.rms"])
    print(
        f"{count} tunings: {unstable} unstable or short of their margin; error held out over searched: "
        f"median {np.median(ratios):.3f}, largest {max(ratios):.3f} (≤ 1.1 wanted)"
    )


def learning(repeats: int = 20) -> None:
    """Servos with 50 ms lag, 20 ms delay, sag and 0.5 mrad of noise, replayed after learning."""
    plant = {"kind": "servo", "time_constant": 0.05, "delay": 0.02, "sag": 1, "encoder_noise": 5e-4}
    for kind, wanted in (("proportional", 30), ("proportional-feedforward", 10)):
        spec = BASE | {"plant": plant, "law": {"kind": kind, "gain": 5}}
        found = dqc.learn(spec, repeats=4)
        errors = [each.position for each in found.repeats]
        after = []
        samples = found.motion.samples(found.first.time - found.first.time[0])
        setting = prepare(spec)
        for seed in range(100, 100 + repeats):
            record = simulate_prepared(
                setting.cases[0].prepare_law(setting.spec),
                setting.cases[0].plant,
                setting.scene.start,
                samples,
                seed=seed,
            )
            ways = np.linalg.norm(record.position - found.first.desired_position, axis=1)
            after.append(1e3 * float(np.sqrt(np.mean(ways**2))))
        best = errors[found.best]
        print(
            f"learning, {kind}: {', '.join(f'{error:.3g}' for error in errors)} mm: 1/{errors[0] / best:.3g} "
            f"(1/{wanted} wanted); {repeats} more runs of the learnt motion: at most {max(after) / best:.3f} × that"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    tasks = {"cost": cost, "fronts": fronts, "winners": winners, "learning": learning}
    parser.add_argument("task", nargs="*", choices=[*tasks, []])
    chosen = parser.parse_args().task or list(tasks)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in chosen:
            tasks[name]()


if __name__ == "__main__":
    main()
