from .options import (
    Force as Force,
    Out as Out,
)
from .screen import (
    print_table as print_table,
    progress_bar as progress_bar,
)
