"""Show that two checkouts compute the same, to the last bit: recordings, metrics and tables of all that they can run.

Examples
--------
::

    git worktree add ../before main~20
    python tools/compare_checkouts.py ../before . --reproduce

Both are run with this Python's libraries; ``--only circle`` takes the specs whose names hold a word.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

REPRODUCTIONS = (
    ("pereira2016", "--plant", "servo", "--repeats", "2"),
    ("pereira2016", "--repeats", "1"),
    ("silva2017", "--repeats", "1"),
)


def commands(checkout: Path, *, reproduce: bool, only: str) -> Iterator[tuple[str, list[str]]]:
    """Yield a name for each thing that a checkout runs, and its command's arguments."""
    for path in sorted((checkout / "examples").glob("*.yaml")):
        if only in path.stem:
            text = path.read_text(encoding="utf-8")
            own = (command for command in ("sweep", "learn", "tune") if f"\n{command}:" in text)
            yield path.stem, [next(own, "run"), str(path)]
    for name, *options in REPRODUCTIONS if reproduce else ():
        label = "-".join([name, *options]).replace("--", "")
        if only in label:
            yield label, ["reproduce", name, *options]


def entry_points(checkout: Path, folder: Path) -> Path:
    """Write the entry points of a checkout where Python looks for them, in place of those that are installed."""
    project = tomllib.loads((checkout / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    information = folder / "dqcontrol-0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: dqcontrol\nVersion: 0\n", encoding="utf-8"
    )
    lines = [
        line
        for group, points in project.get("entry-points", {}).items()
        for line in (f"[{group}]", *(f"{name} = {value}" for name, value in points.items()))
    ]
    (information / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
    return folder


def run(checkout: Path, arguments: list[str], out: Path) -> int:
    """Run one command of a checkout, whose results go to a folder; return its status: 1 says that a task was missed."""
    with tempfile.TemporaryDirectory() as folder:
        return _run(checkout, arguments, out, entry_points(checkout, Path(folder)))


def _run(checkout: Path, arguments: list[str], out: Path, information: Path) -> int:
    path = os.pathsep.join([str(checkout / "src"), str(information)])
    environment = {**os.environ, "PYTHONPATH": path}
    words = [sys.executable, "-m", "dqcontrol", *arguments, "--out", str(out)]
    done = subprocess.run(words, env=environment, cwd=checkout, capture_output=True, text=True, check=False)
    is_done = done.returncode in (0, 1) and out.exists()
    if not is_done:
        print(f"  {shlex.join(arguments)} in {checkout} exits with {done.returncode}: {done.stderr[-300:]}")
    return done.returncode if is_done else 2


def messages(path: Path) -> list[tuple[str, int, bytes]]:
    """Return the messages of a recording; its metadata name the version that wrote it."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return [(c.topic, m.log_time, bytes(m.data)) for _, c, m in make_reader(file).iter_messages()]


def rows(path: Path) -> object:
    """Return the rows of a Parquet file."""
    from pyarrow import parquet

    return parquet.read_table(path).replace_schema_metadata(None)


READERS: dict[str, Callable[[Path], object]] = {
    ".mcap": messages,
    ".parquet": rows,
    ".json": Path.read_bytes,
    ".csv": Path.read_bytes,
}


def differences(before: Path, after: Path) -> Iterator[str]:
    """Yield what is not the same in two folders of results."""
    names = {
        side: {p.relative_to(side) for p in side.rglob("*") if p.suffix in READERS}
        for side in (before, after)
    }
    for name in sorted(names[before] ^ names[after]):
        yield f"{name}: only {'before' if name in names[before] else 'after'}"
    for name in sorted(names[before] & names[after]):
        read = READERS[name.suffix]
        if read(before / name) != read(after / name):
            yield f"{name}: differs"


def main() -> int:
    """Run all in both checkouts; return 1 if anything differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--reproduce", action="store_true", help="the two theses too (minutes)")
    parser.add_argument("--only", default="", help="what the names have to contain")
    options = parser.parse_args()
    sides = [options.before.resolve(), options.after.resolve()]
    alike = True
    with tempfile.TemporaryDirectory() as folder:
        before, after = (
            dict(commands(side, reproduce=options.reproduce, only=options.only)) for side in sides
        )
        for name in before:
            if name not in after:
                print(f"{name}: only before")
                continue
            out = Path(folder) / name
            ran = [
                run(side, words[name], out / label)
                for side, words, label in zip(sides, (before, after), ("before", "after"), strict=True)
            ]
            found = [f"ends with {ran[1]}, before with {ran[0]}"] if ran[0] != ran[1] else []
            found += differences(out / "before", out / "after") if max(ran) <= 1 else ["cannot be compared"]
            alike = alike and not found
            print(f"{name}: {'equal' if not found else '; '.join(found)}", flush=True)
    return 0 if alike else 1


if __name__ == "__main__":
    sys.exit(main())
