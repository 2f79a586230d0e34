from .constraints import (
    Angle as Angle,
    ClearOf as ClearOf,
    Constraints as Constraints,
    LineOfSight as LineOfSight,
    Zone as Zone,
)
from .programs import (
    LevelSolution as LevelSolution,
    ProgramSolution as ProgramSolution,
    lexicographic_program as lexicographic_program,
    quadratic_program as quadratic_program,
)
