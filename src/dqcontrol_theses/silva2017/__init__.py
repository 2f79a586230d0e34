"""[S17]: F. F. A. Silva, feedback linearisation of a whole body against the classic law."""

from __future__ import annotations

from importlib import import_module

from dqcontrol_theses.catalogue import Conditions, Experiment
from dqcontrol_theses.reproduced import Reproduced

EXPERIMENTS = {
    "gains": Experiment("five pairs of gains in simulation (Figs 5.2–5.3)"),
    "comparison": Experiment(
        "nonlinear against classic law, and on 200 random goals (Figs 5.4–5.7, Table 5.1)"
    ),
    "far-goals": Experiment(
        "200 random goals with the limits of joints and wheels, also in physics (chapter 6)"
    ),
    "baselines": Experiment(
        "cascades, parsimonious control and reduced gradient, which it cites (chapter 2)"
    ),
    "clamping": Experiment("a goal beyond the joint limits and back, in simulation (Figs 5.8–5.10)"),
    "clamping-robot": Experiment("motors that give up above their torque (Figs 5.11–5.13)"),
    "discretisation": Experiment("the effect of the control period, left to future work (chapter 6)"),
    "pick-and-drop": Experiment("a cube into a basket, in physics, from what a camera sees (Fig. 5.1)"),
    "two-tables": Experiment("the same from table to table, the base driving between them (beyond Fig. 5.1)"),
}


def reproduce(name: str, conditions: Conditions) -> Reproduced:
    """Run one of `EXPERIMENTS` again.

    Examples
    --------
    >>> from dqcontrol_theses import reproduce
    >>> [row[2] for row in reproduce("silva2017/gains", jobs=1).tables[-1].rows][0]
    'supported'
    """
    module = import_module(f"{__name__}.{name.replace('-', '_')}_experiment")
    return module.reproduce(conditions)


__all__ = ["EXPERIMENTS", "reproduce"]
