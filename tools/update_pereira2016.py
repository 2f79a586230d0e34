"""Write the tables of reproductions of [P16] and a picture into docs: `python tools/update_pereira2016.py [NAME …]`.

Without names all of them; with names, as ``spiral``, their sections of the page.
"""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

from dqcontrol.reproductions import names, reproduce

PAGE = Path(__file__).parents[1] / "docs" / "pereira2016-tables.md"
TIMED = "sampling-time"  # of the loop, not of the physics
PICTURED = {"spiral": "published-and-ours", "light-painting": "light-painting"}  # and which of their figures
REPEATS = 2  # in physics the repeats of a run agree to less than the digits shown
HEAD = f"""# Pereira 2016: published | ours | ratio

Written by `python tools/update_pereira2016.py`, which runs `dqcontrol reproduce NAME --repeats {REPEATS}` for each
heading: the Meka in physics, but for the sampling times, which are about the clock (`--plant servo`). What the
numbers mean: [pereira2016.md](pereira2016.md). ± is the sample standard deviation over the repeats.
"""


def section(name: str) -> str:
    """Run an experiment, and return its part of the page."""
    short = name.partition("/")[2]
    began = time.perf_counter()
    done = reproduce(name, plant="servo" if short == TIMED else None, repeats=REPEATS)
    print(f"{name}: {time.perf_counter() - began:.0f} s", flush=True)
    if short in PICTURED:
        done.figures[PICTURED[short]]().savefig(PAGE.parent / "pictures" / f"pereira2016-{short}.png")
    return "\n".join([f"## {name}\n", *(table.markdown() for table in done.tables)])


def main() -> None:
    """Run what is asked for and write the page."""
    known = names("pereira2016")
    wanted = [full for name in sys.argv[1:] for full in names(name)] or known
    text = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    before = {part.split("\n", 1)[0]: "## " + part for part in re.split("^## ", text, flags=re.MULTILINE)[1:]}
    for name in known:
        if name in wanted:
            before[name] = section(name)
            kept = [before[each].rstrip() + "\n" for each in known if each in before]
            PAGE.write_text("\n".join([HEAD, *kept]), encoding="utf-8")


if __name__ == "__main__":
    main()
