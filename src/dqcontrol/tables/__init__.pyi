from .table_cells import (
    Ratio as Ratio,
    VerdictCell as VerdictCell,
)
from .tables import (
    Cell as Cell,
    Column as Column,
    PlusMinus as PlusMinus,
    Table as Table,
)
