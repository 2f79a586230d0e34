"""Programs with constraints: the solver, and levels of rows that give way."""

from dqcontrol.laws.constrained.programs import (
    LevelSolution,
    ProgramSolution,
    lexicographic_program,
    quadratic_program,
)

__all__ = ["LevelSolution", "ProgramSolution", "lexicographic_program", "quadratic_program"]
