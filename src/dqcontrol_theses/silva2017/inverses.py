"""The inverses as far as S17 does not print them: λ of (4.19), and how N is inverted in the classic law (4.46)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec

from dqcontrol.experiments import PreparedExperiment
from dqcontrol.laws import DampedPoseInverse, FilteredInverse, Law
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.judgement import Judgement
from dqcontrol_theses.silva2017.goal_runs import RaceOutcome, matched_gain, outcome
from dqcontrol_theses.silva2017.specs import GOOD_ENOUGH

FILTERED, EXACT = "filtered", "undamped"
# λ of (4.19), from hardly any effect to where S17's law no longer arrives
LEVELS = (0.02, 0.05, 0.07, 0.09, 0.1)
_DEPENDS_ON = "λ of (4.19)"
UNDAMPED = FilteredInverse(
    threshold=1e-6, damping=1e-6, growth=0.0
)  # no singular value is so small on the way to the goal


@dataclass(frozen=True)
class Compared:
    """A nonlinear law beside the classic one, each run ended by the same stop.

    Attributes
    ----------
    inverse
        That of both, in words.
    nonlinear, classic
        At the printed gains.
    matched
        The classic law with the gain that makes it take as long; None if there is none.
    gain
        That gain.
    """

    inverse: str
    nonlinear: RaceOutcome
    classic: RaceOutcome
    matched: RaceOutcome | None
    gain: float | None

    @property
    def arrives(self) -> bool:
        """Whether the nonlinear law does."""
        return math.isfinite(self.nonlinear.settling)

    @property
    def pace(self) -> float:
        """How many times as long as the classic law it takes."""
        return self.nonlinear.settling / self.classic.settling

    @property
    def efforts(self) -> list[float]:
        """Its effort over the classic law's: at the printed gains, and at equal times where some gain makes them so."""
        classic = [self.classic, *([self.matched] if self.matched else [])]
        return [self.nonlinear.effort / each.effort for each in classic]

    @property
    def efforts_in_words(self) -> str:
        """The same as text."""
        places = ("at the printed gains", "at equal times")
        return ", ".join(f"{each:.2f} {place}" for each, place in zip(self.efforts, places, strict=False))


def compared(
    setting: PreparedExperiment, inverse: str, nonlinear: Law, classic: Law, *, as_s17: bool
) -> Compared:
    """Run both laws on the goal of a spec, with S17's stop or to the end, the classic one also as fast as the other."""
    scene, period = setting.scene, setting.spec.period

    def race(law: Law) -> RaceOutcome:
        return outcome(scene.robot, scene.start, scene.samples, law, period, as_s17=as_s17)

    def classic_at(gain: float) -> RaceOutcome:
        return race(msgspec.structs.replace(classic, gain=gain))

    first = race(nonlinear)
    gain = matched_gain(lambda k: classic_at(k).settling, first.settling)
    return Compared(inverse, first, race(classic), None if gain is None else classic_at(gain), gain)


def with_each_inverse(setting: PreparedExperiment, nonlinear: Law, classic: Law) -> list[Compared]:
    """Run both laws with each inverse, to S17's stop; the first are those of the spec."""
    inverses = {EXACT: UNDAMPED} | {f"λ = {level:g}": DampedPoseInverse(damping=level) for level in LEVELS}
    pairs = {FILTERED: (nonlinear, classic)} | {
        name: tuple(msgspec.structs.replace(law, inverse=inverse) for law in (nonlinear, classic))
        for name, inverse in inverses.items()
    }
    return [compared(setting, name, *pair, as_s17=True) for name, pair in pairs.items()]


def inverse_table(pairs: Sequence[Compared]) -> Table:
    """Return one row an inverse: of both laws, and how their efforts compare where one of them has it or both."""
    first = pairs[0]
    rows: list[list[tuple[Column, Cell]]] = [
        [
            (Column("Inverse"), each.inverse),
            (Column("S17: iterations", "", ".4g"), each.nonlinear.settling),
            (Column("Effort", "rad/√s", ".3g"), each.nonlinear.effort if each.arrives else None),
            (Column("Classic: iterations", "", ".4g"), each.classic.settling),
            (Column("Effort", "rad/√s", ".3g"), each.classic.effort),
            (
                Column("S17 as above over the classic law with this N†", "", ".3g"),
                first.nonlinear.effort / each.classic.effort,
            ),
            (
                Column("S17 over classic, both with this inverse", "", ".3g"),
                each.efforts[0] if each.arrives else None,
            ),
            (Column("Classic law's gain for equal times", "1/s", ".3g"), each.gain),
            (Column("S17 over classic then", "", ".3g"), each.efforts[1] if each.matched else None),
        ]
        for each in pairs
    ]
    title = (
        f"Table 5.1 with inverses that S17 leaves open, to the first error below {GOOD_ENOUGH}; with λ: "
        "Jᵀ(JJᵀ + λ²I)⁻¹ of eight rows as S17 writes it, J in (4.19) and N in (4.46)"
    )
    return Table.of(rows, title)


def judge_inverses(
    pairs: Sequence[Compared], holds: Callable[[Compared], bool], number: Callable[[Compared], str]
) -> Judgement:
    """Judge a sentence with each inverse with which S17's law arrives, as it did on the robot.

    Parameters
    ----------
    pairs
        Of all inverses.
    holds
        Whether it holds with one.
    number
        What was found with one.
    """
    usable = [each for each in pairs if each.arrives] or list(pairs)
    found = [holds(each) for each in usable]
    ends = dict.fromkeys([0, len(usable) - 1])
    text = "; ".join(number(usable[at]) + f" ({usable[at].inverse})" * (len(ends) > 1) for at in ends)
    if all(found) or not any(found):
        return Judgement(found[0], text)
    kept = ", ".join(each.inverse for each, held in zip(usable, found, strict=True) if held)
    return Judgement(None, f"{text}; holds {kept}", depends_on=_DEPENDS_ON)
