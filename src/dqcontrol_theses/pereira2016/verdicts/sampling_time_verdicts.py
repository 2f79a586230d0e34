"""Verdicts on what [P16] says of its control period (5.8) and of the cost of dual quaternions (1.2.2)."""

from __future__ import annotations

from dqcontrol_theses.judgement import ABOUT_THE_PROGRAM, Judgement, by_cases
from dqcontrol_theses.pereira2016.operation_counts import DUAL_QUATERNION, OPERATIONS, TWELVE, WHOLE, count
from dqcontrol_theses.pereira2016.verdicts.evidence import LAWS, Evidence, decides

PERIODS = {"8 ms": 0.008, "20 ms": 0.02}  # s


@decides("rate-is-kept")
def _kept(evidence: Evidence) -> Judgement:
    """Say what ours does on this machine; of the program on the robot's computer it tells nothing."""
    cases = [(law, each, period) for law in LAWS for each, period in PERIODS.items()]
    off = max(abs(evidence.mean(law, each, "period") / period - 1) for law, each, period in cases)
    spread = max(evidence.ours.deviation(law, each, "period") / period for law, each, period in cases)
    return Judgement(
        None,
        f"ours, on this machine: means within {100 * off:.2g} %, deviations within {100 * spread:.2g} % of the period",
        ABOUT_THE_PROGRAM,
    )


@decides("fewer-calculations")
def _fewer(evidence: Evidence) -> Judgement:
    counts = {
        name: {kind: count(operation) for kind, operation in kinds.items()}
        for name, kinds in OPERATIONS.items()
    }
    less = {
        kind: sum(each[DUAL_QUATERNION] < each[kind] for each in counts.values()) for kind in (WHOLE, TWELVE)
    }
    found = ", ".join(
        f"{name} {each[DUAL_QUATERNION]} / {each[WHOLE]} / {each[TWELVE]}" for name, each in counts.items()
    )
    return by_cases(
        {
            "against whole 4 × 4 matrices": less[WHOLE] > len(counts) / 2,
            "against their twelve numbers": less[TWELVE] > len(counts) / 2,
        },
        f"calculations as dual quaternion / 4 × 4 / twelve numbers: {found}; fewer in {less[WHOLE]} and {less[TWELVE]} "
        f"of {len(counts)}",
    )
