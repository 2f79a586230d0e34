import cyclopts

from .options import (
    Force as Force,
    Jobs as Jobs,
    Out as Out,
    ReplaceResults as ReplaceResults,
)
from .screen import (
    print_table as print_table,
    progress_bar as progress_bar,
)

COMMANDS: dict[str, str]
app: cyclopts.App

def add_offered(app: cyclopts.App, group: str, heading: cyclopts.Group | None = None) -> None: ...
def main() -> None: ...
def whole_app() -> cyclopts.App: ...
