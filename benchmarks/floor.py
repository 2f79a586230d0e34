"""Every speed that dqcontrol promises, against its peers in the same run: a table and JSON.

Times are medians of rounds in turns, each the least of short spells; results are compared before they are timed.

    python benchmarks/floor.py [--short] [--json FILE] [--markdown FILE] [--picture FILE]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import batches
import commands
import kinematics
import pereira2016
import quadratic_programs
import rollout
import sizes
import starting
from measure import machine, table, write_json
from rich.console import Console


def main() -> None:
    """Run all, print the table and write the JSON."""
    parser = argparse.ArgumentParser(description="Every speed that dqcontrol promises, against its peers.")
    parser.add_argument(
        "--short", action="store_true", help="few rounds: to see that all works, not how fast"
    )
    parser.add_argument("--json", type=Path, help="file for the figures")
    parser.add_argument("--markdown", type=Path, help="file for the table")
    parser.add_argument("--picture", type=Path, help="file for the picture of cost against size")
    chosen = parser.parse_args()
    parts = (
        kinematics.ratios,
        commands.ratios,
        quadratic_programs.ratios,
        rollout.ratios,
        pereira2016.ratios,
        batches.ratios,
        starting.ratios,
    )
    ratios = [line for part in parts for line in part(chosen.short)]
    ratios += sizes.ratios(chosen.short, chosen.picture)
    about = ", ".join(f"{name} {text}" for name, text in machine().items())
    Console(width=200).print(table(ratios, about).rich())
    if chosen.markdown is not None:
        chosen.markdown.write_text(table(ratios, about).markdown(), encoding="utf-8")
    if chosen.json is not None:
        write_json(ratios, chosen.json)


if __name__ == "__main__":
    main()
