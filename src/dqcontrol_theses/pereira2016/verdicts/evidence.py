"""Evidence for verdicts, and how verdicts on claims are registered and given."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.experiments import PreparedExperiment, execute, prepare
from dqcontrol.loop import Record, has_failed
from dqcontrol_theses.judgement import Case, Judgement, by_cases
from dqcontrol_theses.pereira2016.gain_x100 import SUFFIX, with_gain_x100
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PLANTS, published_spec
from dqcontrol_theses.pereira2016.published_numbers import published_cells
from dqcontrol_theses.results import Results, Row

PROPORTIONAL, LQR, ROBUST = ("K", "K+FF"), ("LQR-R8", "LQR-DQ"), ("HIR", "HIRT")
LAWS = (*PROPORTIONAL, *LQR, *ROBUST)
# of Err, L.Vel or Eff: beyond it the law strayed or shook, and what is said of it is not tested
MOST_OVER_PRINTED = 2.0
START = 5.0  # s; "in the beginning of the trajectory"

Look = Callable[[tuple[str, ...], str], tuple[bool, str]]
Cases = dict[str, Case]


@dataclass(frozen=True)
class Evidence:
    """The results of a reproduction, and the means to run more of it.

    Attributes
    ----------
    ours
        Metrics of all repeats.
    settings
        The specs made ready, by the experiment's name in the published tables.
    plant
        What the Meka is, one of `PLANTS`.
    reproduction
        The experiment's name.
    late
        Published criteria of laws that did not keep their period on the robot, run at the one that is printed of them,
        by law and set: what is said of them is judged by these runs, as the printed tables are over them [P16 5.7].
    """

    ours: Results
    settings: Mapping[str, PreparedExperiment]
    plant: str = PLANTS[0]
    reproduction: str = ""
    late: Mapping[tuple[str, str], Mapping[str, float]] = field(default_factory=dict)
    _records: dict[tuple[str, str, str], Record] = field(init=False, repr=False, default_factory=dict)

    def mean(self, law: str, parameters: str = "", metric: str = "error", experiment: str = "") -> float:
        """Return the mean of a metric over the repeats, or of a law that was late its run at the printed period."""
        run = self.late.get((law, parameters), {}) if not experiment else {}
        return run[metric] if metric in run else self.ours.mean(law, parameters, metric, experiment)

    def followed(self, law: str, sets: Sequence[str] = ("",)) -> bool:
        """Tell whether a law came as near to its path, and as smoothly, as `MOST_OVER_PRINTED` says, in all sets."""
        printed = {
            (cell.law, cell.set, cell.metric): cell.mean for cell in published_cells(self.reproduction)
        }
        label = law.removesuffix(SUFFIX)
        return all(
            self.mean(law, each, metric) <= MOST_OVER_PRINTED * printed[label, each, metric]
            for each in sets
            for metric in ("error", "hand_speed", "joint_step")
        )

    def of_robust(self, look: Look, sets: Sequence[str] = ("",)) -> tuple[Cases, str]:
        """Return the cases of a sentence on HIR and HIRT, one a set of gains, and their numbers.

        Each is judged by the first reading of the gains with which both laws followed their path, and is not tested
        where none did.

        Parameters
        ----------
        look
            Takes the labels of both and the set; returns whether the sentence holds of them, and the number.
        sets
            Of gains.
        """
        cases: Cases = {}
        texts = []
        for each in sets:
            holds = None
            for name, suffix in (("gains as printed", ""), ("× 100", SUFFIX)):
                laws = tuple(law + suffix for law in ROBUST)
                if all(self.ours.sets(law) for law in laws):
                    follows = all(self.followed(law, [each]) for law in laws)
                    verdict, number = look(laws, each)
                    holds = verdict if holds is None and follows else holds
                    said = f"{name}{'' if follows else ', which do not follow'}"
                    texts.append(" ".join(filter(None, (each, said))) + f": {number}")
            cases[f"HIR and HIRT{' ' * bool(each)}{each}"] = holds
        return cases, "; ".join(texts)

    def judged_by_robust(self, look: Look, sets: Sequence[str] = ("",), what: str = "") -> Judgement:
        """Return the verdict on a sentence that is about HIR and HIRT alone, its numbers named; see `of_robust`."""
        cases, text = self.of_robust(look, sets)
        return by_cases(cases, what + text)

    def by_set(self, law: str, metric: str = "error", experiment: str = "") -> list[float]:
        """Return the mean of a metric with each set that a law ran with."""
        return [self.mean(law, each, metric, experiment) for each in self.ours.sets(law, experiment)]

    def period(self, experiment: str = "") -> float:
        """Return the control period, s."""
        return self.settings[experiment].spec.period

    def record(self, law: str, parameters: str = "", experiment: str = "") -> Record:
        """Return the first repeat, sample by sample; it is run again, which gives the same numbers."""
        names = self.ours.sets(law, experiment)
        parameters = names[0] if not parameters and len(names) == 1 else parameters
        key = (experiment, law, parameters)
        if key not in self._records:
            self._records[key] = record_of(self.settings[experiment], law, parameters)
        return self._records[key]

    def first_peak(self, signal: str, law: str, parameters: str = "", experiment: str = "") -> float:
        """Return the peak of hand_speed, hand_acceleration or joint_step in the first five seconds."""
        return self.peak(signal, law, parameters, experiment, later=False)

    def peak(self, signal: str, law: str, parameters: str, experiment: str, *, later: bool) -> float:
        """Return the peak of such a signal in the first five seconds, or after them."""
        record = self.record(law, parameters, experiment)
        count = int(np.searchsorted(record.time, START))
        period, part = self.period(experiment), slice(count, None) if later else slice(count)
        if signal == "joint_step":
            values = np.diff(record.q[part], axis=0)
        else:
            values = np.diff(record.position[part], axis=0) / period
            if signal == "hand_acceleration":
                values = np.diff(values, axis=0) / period
        return float(np.linalg.norm(values, axis=1).max())

    def changed(self, spec: str, labels: tuple[str, ...], **changes: Any) -> PreparedExperiment:
        """Return a published spec with some laws only, run once, on the same plant, with other keys changed.

        A change ``laws`` overrides keys of the laws; None takes a key away.
        """
        data = with_gain_x100(published_spec(spec, self.plant))
        overrides = changes.pop("laws", {})
        data["laws"] = {law: data["laws"][law] | overrides.get(law, {}) for law in labels}
        for key in ("parameter_sets", "grids", "repeats", "skip_initial"):
            data.pop(key, None)
        for key, value in changes.items():
            if value is None:
                data.pop(key, None)
            else:
                data[key] = value
        return prepare(data)


def agreed(choice: str, first: bool, second: bool) -> Case:
    """Return what both ways to choose what the source does not tell say of a case, or what it depends on."""
    return first if first == second else choice


RICCATI = "how (3.44) is solved"
"""The choice of linear quadratic laws that P16 does not tell: by Euler steps or exactly."""


Judge = Callable[[Evidence], Judgement]
JUDGES: dict[str, Judge] = {}


def decides(claim: str) -> Callable[[Judge], Judge]:
    """Register a function that decides a claim."""

    def register(judge: Judge) -> Judge:
        JUDGES[claim] = judge
        return judge

    return register


def first_speed(record: Record) -> float:
    """Return the peak of the hand's speed in the first five seconds, m/s."""
    count = int(np.searchsorted(record.time, START))
    steps = np.linalg.norm(np.diff(record.position[:count], axis=0), axis=1)
    return float((steps / np.diff(record.time[:count])).max())


def record_of(
    setting: PreparedExperiment, law: str, parameters: str = "", *, plant: str | None = None
) -> Record:
    """Run one case of a setting once."""
    for case in setting.cases:
        if case.names.law == law and case.names.set == parameters and plant in (None, case.names.plant):
            return execute(setting, case)
    raise LookupError(f"{law} · {parameters}")


def grid_of(rows: Sequence[Row], key: str) -> tuple[list[float], list[float], Array]:
    """Return the values of q and r and the metric for each pair, shape (len(q), len(r)); NaN where a run failed."""
    qs, rs = (
        sorted({row[f"parameter.{name}"] for row in rows}) for name in ("error_weight", "control_weight")
    )
    grid = np.full((len(qs), len(rs)), math.nan)
    for row in rows:
        if not has_failed(str(row["stopped"])):
            place = qs.index(row["parameter.error_weight"]), rs.index(row["parameter.control_weight"])
            grid[place] = row[key]
    return qs, rs, grid
