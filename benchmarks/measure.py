"""What the benchmarks share: timings taken in turns, and a table of ratios with what is wanted of them."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

import dqcontrol
from dqcontrol.tables import Column, Table

PEERS = ("numpy", "numba", "pin", "mujoco", "dqrobotics", "pin-pink", "mink")


@dataclass(frozen=True)
class Ratio:
    """One line of the table: ours against a peer's, in the same unit."""

    what: str
    ours: float
    unit: str
    peer: str  # empty where the figure itself is judged
    theirs: float
    wanted: str  # as "≤ 0.60"

    @property
    def ratio(self) -> float:
        """Return ours by theirs."""
        return self.ours / self.theirs

    @property
    def reached(self) -> bool:
        """Return whether the ratio is as wanted."""
        sign, number = self.wanted.split()
        return self.ratio <= float(number) if sign == "≤" else self.ratio >= float(number)


def medians(
    functions: Mapping[str, Callable[[], object]], repeat: int, rounds: int = 15, spell: float = 2e-3
) -> dict[str, float]:
    """Return the time of each function in µs: the median of rounds taken in turns, each the least of its spells.

    Another process on the same core lengthens a spell at once by its whole time slice, so the least of some short
    spells is what the function takes by itself.
    """
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            least = np.inf
            for _ in range(max(repeat // 50, 3)):
                start = time.perf_counter()
                for _ in range(50 if repeat >= 50 else 1):
                    function()
                least = min(least, (time.perf_counter() - start) / (50 if repeat >= 50 else 1))
            times[name].append(least * 1e6)
    return {name: float(np.median(values)) for name, values in times.items()}


def table(ratios: list[Ratio], title: str) -> Table:
    """Return the ratios as a table."""
    columns = (
        Column("what"),
        Column("ours", "", ".3g"),
        Column("unit"),
        Column("against"),
        Column("theirs", "", ".3g"),
        Column("ratio", "", ".2g"),
        Column("wanted"),
        Column(""),
    )
    rows = [
        [
            r.what,
            r.ours,
            r.unit or None,
            r.peer or None,
            r.theirs if r.peer else None,
            r.ratio if r.peer else None,
            r.wanted,
            "" if r.reached else "missed",
        ]
        for r in ratios
    ]
    return Table(columns, rows, title)


def machine() -> dict[str, str]:
    """Return what the figures depend on: the processor, Python and the versions of all that is timed."""
    about = {"processor": _processor(), "system": platform.platform(), "Python": platform.python_version()}
    about["dqcontrol"] = dqcontrol.__version__
    for name in PEERS:
        try:
            about[name] = version(name)
        except PackageNotFoundError:
            about[name] = "not installed"
    return about


def write_json(ratios: list[Ratio], path: Path) -> None:
    """Write the ratios with machine, versions and date."""
    rows = [{**asdict(r), "ratio": r.ratio, "reached": r.reached} for r in ratios]
    data = {"date": date.today().isoformat(), "machine": machine(), "ratios": rows}
    path.write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "unknown")
