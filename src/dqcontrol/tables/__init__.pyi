from .tables import (
    Cell as Cell,
    Column as Column,
    PlusMinus as PlusMinus,
    Ratio as Ratio,
    Table as Table,
    VerdictCell as VerdictCell,
)
