"""Verdicts on claims of [P16] that need runs beside the published ones."""

from __future__ import annotations

import math
import time

import numpy as np

from dqcontrol.experiments import PreparedExperiment
from dqcontrol.measures import evaluate
from dqcontrol.references import Sample
from dqcontrol_theses.judgement import ABOUT_THE_PROGRAM, ABOUT_THE_ROBOT, Judgement, by_cases, listed
from dqcontrol_theses.pereira2016.own_periods import stretch
from dqcontrol_theses.pereira2016.pereira2016_catalogue import EXACT, PHYSICS, published_spec
from dqcontrol_theses.pereira2016.verdicts.evidence import (
    LAWS,
    LQR,
    RICCATI,
    Evidence,
    agreed,
    decides,
    record_of,
)

_CALLS, _ROUNDS = 400, 15
_SAME = 0.01


@decides("exponential-decay-checked")
def _decay(evidence: Evidence) -> Judgement:
    """Measure the decay of a pure position error, at a period so short that (1 − kT) is the exponential."""
    period = 2e-4
    setting = evidence.changed(
        "spiral",
        LAWS,
        period=period,
        plant={"kind": "integrator"},
        reference={"kind": "set-point", "duration": 0.2, "offset": {"translation": [0, 0, 0.07]}},
        laws={"LQR-R8": {"error_weight": 270}},
        metrics_from=None,
    )
    gains = {
        "K": 125,
        "K+FF": 125,
        "LQR-R8": np.sqrt(27000),
        "LQR-DQ": np.sqrt(27000),
        "HIR": 2.4,
        "HIRT": 2.4,
    }
    slopes = []
    for law in LAWS:
        record = record_of(setting, law)
        kept = record.position_error > 0.02 * record.position_error[0]
        slope = np.polyfit(record.time[kept], np.log(record.position_error[kept]), 1)[0]
        slopes.append(float(-slope / gains[law]))
    return Judgement(
        None,
        f"decay over gain on ideal joints {listed(slopes)} ({', '.join(LAWS)}); that of the robot is not printed, and "
        "a ratio of integrals shows no decay",
        ABOUT_THE_ROBOT,
    )


@decides("lqr-takes-longer")
def _time(evidence: Evidence) -> Judgement:
    setting = evidence.settings[""]
    laws = {}
    for case in setting.cases:
        if case.names.set == "best":
            laws[case.names.law] = (case.prepare_law(setting.spec), case.scene.samples[100], case.scene.start)
    times: dict[str, list[float]] = {law: [] for law in laws}
    for _ in range(_ROUNDS):
        for law, (prepared, row, q) in laws.items():
            state, sample = prepared.initial_state(q), Sample(row[0:8], row[8:14], row[14:20], row[20])
            out = np.empty(len(q))
            start = time.perf_counter()
            for _ in range(_CALLS):
                prepared.command(q, sample, state, out)
            times[law].append((time.perf_counter() - start) / _CALLS)
    median = {law: float(np.median(values)) for law, values in times.items()}
    ratios = [median[law] / median["K"] for law in LQR]
    share = max(median[law] for law in LQR) / setting.spec.period
    return Judgement(
        None,
        f"one command of R8 and DQ over K's, compiled: {listed(ratios, '.2f')}; {100 * share:.2g} % of the period at "
        "most, so that no trajectory takes longer",
        ABOUT_THE_PROGRAM,
    )


@decides("duration-does-not-matter")
def _duration(evidence: Evidence) -> Judgement:
    """Compare runs of as many samples at a longer period, for the two periods that a program may multiply by."""
    nominal, law = 0.008, "LQR-DQ"
    printed = nominal * stretch(law, nominal)
    longer = 0.009 if evidence.plant == PHYSICS else printed  # s; controllers in physics tick each ms

    def error(period: float, multiplied_by: float) -> float:
        reference = published_spec("spiral", evidence.plant)["reference"] | {"duration": 2999 * period}
        # a gain of √(q/r), as much smaller as the step of the command
        weight = 270 * (multiplied_by / period) ** 2
        setting = evidence.changed(
            "spiral", (law,), period=period, reference=reference, laws={law: {"error_weight": weight}}
        )
        return evaluate(record_of(setting, law)).error.integral

    before = error(nominal, nominal)
    exponent = math.log(printed / nominal) / math.log(longer / nominal)
    true, kept = ((error(longer, step) / before) ** exponent for step in (longer, nominal))
    return by_cases(
        {
            law: agreed(
                "which period the program multiplies commands by",
                *(abs(ratio - 1) <= _SAME for ratio in (true, kept)),
            )
        },
        f"Err of {law} at the printed {1e3 * printed:.4g} ms over {1e3 * nominal:g} ms: {true:.3f} if the program "
        f"multiplies commands by the true period, {kept:.3f} if by the nominal one, which is nearer to its tables",
    )


@decides("shorter-period-improves-lqr")
def _shorter(evidence: Evidence) -> Judgement:
    """Judge the cause by the same gain at the shorter period."""
    law = "LQR-R8"
    circle, shorter = (
        _mean_error(evidence.changed("circle", (law,), period=period), law) for period in (0.02, 0.008)
    )
    spiral = evidence.mean(law, "best", "error.mean")
    return by_cases(
        {"a smaller error": spiral < circle, "the shorter period as its cause": shorter < circle},
        f"mean Err {spiral:.4f} (spiral, 8 ms, gain 164) against {circle:.4f} (circle, 20 ms, 31.6), which the shorter "
        f"period alone makes {shorter:.4f}",
    )


@decides("lqr-varies-with-trajectory")
def _varies(evidence: Evidence) -> Judgement:
    circle = evidence.changed("circle", ("K", *LQR))
    spreads = {}
    for law, gain, high in (
        ("K", 50, 125),
        ("LQR-R8", 31.62, 164.3),
        ("LQR-R8" + EXACT, 31.62, 164.3),
        ("LQR-DQ", 31.62, 164.3),
    ):
        products = [_mean_error(circle, law.removesuffix(EXACT)) * gain * 0.02]
        for share, each in ((1.0, "best"), (np.log(2), "ln2"), (np.log(2) ** 2, "ln2²")):
            part = share if law == "K" else np.sqrt(share)
            products.append(evidence.mean(law, each, "error.mean") * high * part * 0.008)
        spreads[law] = float(np.ptp(products) / np.mean(products))
    text = ", ".join(f"{law} {100 * spread:.0f} %" for law, spread in spreads.items())
    euler, exact, dq = (spreads[law] > spreads["K"] for law in ("LQR-R8", "LQR-R8" + EXACT, "LQR-DQ"))
    return by_cases(
        {"LQR-R8": agreed(RICCATI, euler, exact), "LQR-DQ": dq},
        f"spread of mean Err × gain × period over circle and spiral: {text}",
    )


@decides("high-gain-chatters")
def _chatters(evidence: Evidence) -> Judgement:
    setting = evidence.changed("spiral", ("K",), laws={"K": {"gain": 2.2 / 0.008}})
    record = record_of(setting, "K")
    high, low = (evaluate(each).hand_acceleration.integral for each in (record, evidence.record("K", "best")))
    return Judgement(high / low > 2, f"L.Acc of K at kT = 2.2 over kT = 1: {high / low:.2f}")


def _mean_error(setting: PreparedExperiment, law: str) -> float:
    return evaluate(record_of(setting, law)).error.mean
