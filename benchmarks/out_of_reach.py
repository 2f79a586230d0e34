"""How calm laws stay where a target is out of reach, and what that costs within reach; goals stand beside the values.

python benchmarks/out_of_reach.py             all tables, some minutes
python benchmarks/out_of_reach.py --growth 0  as if damping did not grow
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator

import msgspec
import numpy as np
from scipy.optimize import minimize

import dqcontrol as dqc
from dqcontrol import algebra, laws
from dqcontrol.arrays import Array
from dqcontrol.laws.constrained.constraints import Lag
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator

SEED = 38
TURNING = 0.01  # rad/s: slower joints are at rest
HONEST = 12.0  # rad/s²: between two periods a joint that turns back honestly may change its speed by so much times T
STARTS = {
    "panda": [0, -0.3, 0, -2.0, 0, 1.7, 0.7],
    "ur5": [0, -1.2, 1.5, -1.8, -1.5, 0.3],
    "iiwa7": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "youbot-arm": [0.1, 0.4, -0.6, 0.3, 0.2],
    "little-john": [0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4],
}
PERIODS = (0.001, 0.01, 0.033)  # s
SERVOS = ((0.0, 0.0), (0.03, 0.0), (0.1, 0.02), (0.3, 0.05), (0.0, 0.05))  # lag and delay, s


def all_laws(k: float) -> dict[str, laws.Law]:
    """Return laws of loop gain k, 1/s."""
    return {
        "K": laws.Proportional(gain=k),
        "K+FF": laws.ProportionalFeedforward(gain=k),
        "decoupled": laws.DecoupledProportional(gain=k),
        "HIR, right": laws.HInfinity(orientation_gain=2 * k, translation_gain=k),
        "HIRT, left": laws.HInfinityTracking(orientation_gain=2 * k, translation_gain=k, form="left"),
        "LQR-R8": laws.LinearQuadraticR8(error_weight=k * k, control_weight=1.0),
        "LQR-DQ, left": laws.LinearQuadraticDQ(error_weight=k * k, control_weight=1.0, error="left"),
        "feedback linearisation": laws.FeedbackLinearization(
            stiffness=16 * k * k, damping=4 * k, null_space=None
        ),
    }


def with_growth(law: laws.Law, growth: float | None) -> laws.Law:
    """Return a law with another growth of its inverse."""
    inverse = msgspec.structs.replace(law.inverse, growth=growth)  # type: ignore[attr-defined]
    return msgspec.structs.replace(law, inverse=inverse)


def placed(pose: Array, position: Array) -> Array:
    """Return a pose of the same orientation at another position."""
    moved = np.zeros(8)
    moved[0], moved[5:8] = 1.0, 0.5 * position
    return algebra.multiply(moved, np.concatenate([pose[:4], np.zeros(4)]))


def stretched(robot: dqc.Robot, q: Array, direction: Array | None = None) -> Array:
    """Return the joints with the hand furthest from the base, or along a direction; mobile bases rest."""
    still = robot.configuration_size - 5 if robot.drives.size else 0

    def short(x: Array) -> float:
        hand = algebra.translation(robot.fkm(np.concatenate([q[:still], x])))
        return -float(np.linalg.norm(hand) if direction is None else direction @ hand)

    bounds = list(zip(robot.limits.lower[still:], robot.limits.upper[still:], strict=True))
    return np.concatenate([q[:still], minimize(short, q[still:], bounds=bounds).x])


def furthest(robot: dqc.Robot, q: Array, direction: Array) -> Array:
    """Return the pose of the hand at its furthest along a direction."""
    return robot.fkm(stretched(robot, q, direction))


def resting_targets(robot: dqc.Robot, q: Array) -> dict[str, Array]:
    """Return targets that nothing of the robot reaches, by name."""
    pose = robot.fkm(q)
    direction = algebra.translation(pose) / np.linalg.norm(algebra.translation(pose))
    far = furthest(robot, q, direction)
    reach = float(np.linalg.norm(algebra.translation(far)))
    along = {"twice the reach": 2 * reach, "10 m": 10.0}
    beyond = {f"{way * 1e3:g} mm beyond": way for way in (0.001, 0.003, 0.01, 0.03, 0.1)}
    return {
        **{name: placed(pose, way * direction) for name, way in along.items()},
        **{name: placed(far, algebra.translation(far) + way * direction) for name, way in beyond.items()},
        "above": placed(pose, np.array([0.05, 0.1, 2 * reach])),
        "aside": placed(pose, np.array([0.2, -2 * reach, 0.3])),
    }


def follow(
    prepared: laws.PreparedLaw,
    q: Array,
    samples: Callable[[int], dqc.Sample],
    steps: int,
    servo: tuple[float, float] = (0.0, 0.0),
    *,
    integrated: bool = False,
) -> tuple[Array, Array]:
    """Let a law drive a robot in a loop of one's own, scaled to the velocity limits; return commands, configurations.

    Joints follow with a lag and a delay (s); ``integrated``: the law is told where their targets are.
    """
    robot, period = prepared.robot, prepared.dt
    state, wanted, joints = prepared.initial_state(q), q.copy(), q.copy()
    late = [q.copy()] * (round(servo[1] / period) + 1)
    share = 1.0 if servo[0] == 0.0 else 1.0 - np.exp(-period / servo[0])
    sent, gone = np.empty((steps, robot.input_size)), np.empty((steps, q.size))
    for k in range(steps):
        u = prepared.command(wanted if integrated else joints, samples(k), state)
        u = u / max(1.0, np.max(np.abs(u) / robot.limits.velocity))
        prepared.sent(state, u)
        wanted = robot.integrate(wanted, u, period)
        late = [*late[1:], wanted]
        joints = joints + share * (late[0] - joints)
        sent[k], gone[k] = u, joints
    return sent, gone


def reversing(sent: Array, jump: float = 2 * TURNING) -> float:
    """Return the share of periods in which some joint turns back, both ways at speed, by more than a jump, rad/s."""
    before, after = sent[:-1], sent[1:]
    moving = np.minimum(np.abs(before), np.abs(after)) > TURNING
    return float(((before * after < 0) & moving & (np.abs(after - before) > jump)).any(axis=1).mean())


def worst_at_rest(
    name: str, law: str, period: float, growth: float | None, targets: tuple[str, ...] = ()
) -> tuple[float, str]:
    """Return the worst share of reversing periods in the last quarter of a rest out of reach, and where."""
    robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
    k = min(10.0, 0.5 / period)
    prepared = with_growth(all_laws(k)[law], growth).prepare(robot, None, period)
    worst, where = 0.0, ""
    for target, pose in resting_targets(robot, q).items():
        if targets and target not in targets:
            continue
        sample, steps = dqc.Sample(pose), max(round(4.0 / period), 600)
        sent, _ = follow(prepared, q, lambda _, sample=sample: sample, steps)
        share = reversing(sent[-steps // 4 :])
        if share > worst:
            worst, where = share, target
    return worst, where


def streams(
    robot: dqc.Robot, q: Array, period: float, seconds: float
) -> Iterator[tuple[str, list[dqc.Sample]]]:
    """Yield hostile streams of targets: 3 s of calm, then what people and cameras do, then calm again."""
    rng = np.random.default_rng(SEED)
    home, steps = robot.fkm(q), round(seconds / period)
    reach = float(np.linalg.norm(algebra.translation(furthest(robot, q, np.array([1.0, 0, 0])))))
    held = max(round(1 / 30 / period), 1)  # a camera's frames
    turns = [algebra.exp_screw(np.array([*(0.5 * np.pi * axis), 0, 0, 0])) for axis in np.eye(3)]

    def at(position: Array, turn: Array | None = None) -> Array:
        pose = placed(home, position)
        return pose if turn is None else algebra.multiply(pose, turn)

    here = algebra.translation(home)
    ball = rng.normal(size=(2000, 3))
    ball *= (reach * rng.uniform(0.2, 1.6, (2000, 1))) / np.linalg.norm(ball, axis=1, keepdims=True)

    def circle(time: float, radius: float, rate: float) -> Array:
        return radius * np.array([np.cos(rate * time), np.sin(rate * time), 0.3])

    def made(wanted: Callable[[int], Array]) -> list[dqc.Sample]:
        calm = round(3.0 / period)
        rest = [dqc.Sample(home)] * calm
        return [*rest, *(dqc.Sample(wanted(k)) for k in range(steps)), *rest]

    second = round(1.0 / period)  # seldom enough that turns which a jump of the target asks for count little
    yield "teleports", made(lambda k: at(ball[k // second]))
    yield "circle outside at 30 Hz", made(lambda k: at(circle((k // held) * held * period, 1.3 * reach, 1.0)))
    yield "circle at the edge", made(lambda k: at(circle(k * period, 1.02 * reach, 0.5)))
    yield "through the base", made(lambda k: at((1 - 2 * ((k * period / 4) % 1)) * here))
    yield "in and out", made(lambda k: at((1 + 0.6 * np.sin(1.5 * k * period)) * here * reach / 0.8))
    yield "half turns", made(lambda k: at(here, turns[(k // second) % 3]))
    yield "jitter outside", made(lambda k: at(1.5 * reach * here + 0.003 * ball[k // held]))
    yield "gaps outside", made(lambda k: at(circle((k // (9 * held)) * 9 * held * period, 1.2 * reach, 1.0)))


def stream_table(growth: float | None, seconds: float = 6.0) -> None:
    """Print shares of reversing periods of streams, over robots, servos and ways to close the loop."""
    print(
        "\nhostile streams: reversing periods, %, mean and worst (goal 0.5 and 5); greatest step / (limit · T) (goal 1)"
    )
    for period in (0.01, 0.033):
        for name in ("panda", "ur5", "iiwa7"):
            robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
            given = list(streams(robot, q, period, seconds))
            shares, places, most = [], [], 0.0
            for servo in SERVOS:
                for integrated in (False, True):
                    if integrated and servo not in ((0.1, 0.02), (0.3, 0.05)):
                        continue
                    late = sum(servo) if not integrated else 0.0
                    k = min(10.0, 0.3 / (late + period))
                    lag = Lag((servo[0],) * q.size, (servo[1],) * q.size) if late else Lag()
                    law = with_growth(laws.DecoupledProportional(gain=k), growth)
                    prepared = law.prepare(robot, None, period, lag=lag)
                    for stream, samples in given:
                        sent, gone = follow(
                            prepared, q, samples.__getitem__, len(samples), servo, integrated=integrated
                        )
                        shares.append(reversing(sent, HONEST * period))
                        places.append(f"{stream}, lag {servo[0]:g} delay {servo[1]:g} s")
                        limit = robot.limits.velocity * period
                        most = max(most, float((np.abs(np.diff(gone, axis=0)) / limit).max()))
            worst = int(np.argmax(shares))
            print(
                f"  {name:12} {period * 1e3:4.0f} ms  {100 * np.mean(shares):6.2f}  {100 * shares[worst]:6.2f}"
                f"  {most:.3f}  ({places[worst]})",
                flush=True,
            )


def rest_table(growth: float | None) -> None:
    """Print the worst of resting targets, law by law."""
    print("\nresting targets out of reach: reversing periods, %, worst of nine targets (goal 0)")
    print(f"  {'':24}" + "".join(f"{name:>14}" for name in STARTS))
    for period in PERIODS:
        for law in all_laws(1.0):
            found = [worst_at_rest(name, law, period, growth) for name in STARTS]
            print(
                f"  {period * 1e3:3.0f} ms {law:18}" + "".join(f"{100 * share:14.1f}" for share, _ in found),
                *{where for _, where in found if where},
                flush=True,
            )


def swung(
    robot: dqc.Robot, middle: Array, swing: Array, period: float, seconds: float
) -> tuple[Array, list[dqc.Sample]]:
    """Return the start and the samples of a path that joints describe, so that all of it is within reach."""
    times = period * np.arange(round(seconds / period))
    q = middle + np.sin(1.5 * times)[:, None] * swing
    rates = 1.5 * np.cos(1.5 * times)[:, None] * swing
    twists = [robot.twist_jacobian(each) @ rate for each, rate in zip(q, rates, strict=True)]
    return q[0], [dqc.Sample(robot.fkm(each), twist) for each, twist in zip(q, twists, strict=True)]


def errors(robot: dqc.Robot, gone: Array, samples: list[dqc.Sample]) -> float:
    """Return the RMS distance of the hand from its target a period later, m."""
    targets = np.array([sample.pose for sample in samples[1:]])
    away = algebra.translation(robot.fkm(gone[:-1])) - algebra.translation(targets)
    return float(np.sqrt((away**2).sum(axis=1).mean()))


def reach_table() -> None:
    """Print errors on stretched paths, over those without growth, and whether calm paths are equal to the bit."""
    print(
        "\nwithin reach, kT 0.33: RMS error over that without growth (goal 1.02) of K and K+FF, almost stretched"
    )
    print("and back; and in the middle, where commands are to be equal to the bit")
    for name in ("panda", "ur5", "iiwa7", "youbot-arm"):
        robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
        far = stretched(robot, q)
        cells = []
        for middle, swing in ((far + 0.15 * (q - far), 0.12 * (q - far)), (q, np.full(q.size, 0.1))):
            begin, samples = swung(robot, middle, swing, 0.033, 8.0)
            for law in ("K", "K+FF"):
                both = [
                    follow(
                        with_growth(all_laws(10.0)[law], growth).prepare(robot, None, 0.033),
                        begin,
                        samples.__getitem__,
                        len(samples),
                    )[1]
                    for growth in (None, 0.0)
                ]
                ratio = errors(robot, both[0], samples) / errors(robot, both[1], samples)
                cells.append(f"{ratio:.4f}" if middle is not q else str(np.array_equal(*both)))
        print(f"  {name:12}" + "".join(f"{cell:>10}" for cell in cells), flush=True)


def step_table(rounds: int = 15, steps: int = 3000) -> None:
    """Print what a step takes over that without growth, least of several interleaved rounds."""
    print(
        "\na step of the compiled loop over that without growth (goal 1.1): 1 mm, 2 cm, 20 cm away; at rest outside"
    )
    for name in ("panda", "ur5", "youbot-arm"):
        robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
        law, outside = laws.ProportionalFeedforward(gain=10.0), resting_targets(robot, q)["twice the reach"]
        prepared = law.prepare(robot, None, 0.01)
        rested = follow(prepared, q, lambda _: dqc.Sample(outside), 600)[1][-1]  # noqa: B023
        pose = robot.fkm(q)
        here = algebra.translation(pose)
        cells = []
        for begin, target in (
            *((q, placed(pose, here - np.array([way, 0, 0]))) for way in (0.001, 0.02, 0.2)),
            (rested, outside),
        ):
            samples = np.repeat(dqc.Sample(target).numbers[None], steps, axis=0)
            best = [np.inf, np.inf]
            both = [with_growth(law, growth).prepare(robot, None, 1e-6) for growth in (None, 0.0)]
            for _ in range(rounds):
                for i, each in enumerate(both):
                    plant, started = Integrator().start(robot, begin, 1e-6, steps, 0), time.perf_counter()
                    close_loop(each, plant, samples)
                    best[i] = min(best[i], time.perf_counter() - started)
            cells.append(best[0] / best[1])
        print(f"  {name:12}" + "".join(f"{cell:8.2f}" for cell in cells), flush=True)


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--growth", type=float, help="c of the inverse; by the law's loop if omitted")
    parser.add_argument("--tables", default="reach,steps,rest,streams", help="which of them")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    print(f"seed {SEED}")
    tables: dict[str, Callable[[], None]] = {
        "reach": reach_table,
        "steps": step_table,
        "rest": lambda: rest_table(asked.growth),
        "streams": lambda: stream_table(asked.growth),
    }
    for name in asked.tables.split(","):
        tables[name]()


if __name__ == "__main__":
    main()
