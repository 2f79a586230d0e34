"""Check wheel and source archive as one who installs them does, and that all public names have types.

Both are installed into fresh environments, away from this repository, and run a demo of a second there.

    python tools/check_release.py dist
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

LEAST_TYPED = 0.99  # of public names
NEEDED = ("py.typed", "robots/models/iiwa7.yaml")
SPEC = """
name: release
robot: iiwa7
start: [0, 0.6, 0, 1.6, 0, 0.6, 0]
period: 0.01
reference: {kind: circle, radius: 0.05, duration: 1.0}
law: {kind: proportional-feedforward, gain: 5}
plant: {kind: servo}
"""


def main() -> None:
    """Check all, or end with what is wrong."""
    folder = Path(sys.argv[1]).resolve()
    archives = sorted(folder.glob("*.whl")) + sorted(folder.glob("*.tar.gz"))
    if [path.suffix for path in archives] != [".whl", ".gz"]:
        sys.exit(
            f"{folder}: expected one wheel and one source archive, got {[path.name for path in archives]}"
        )
    for archive in archives:
        with tempfile.TemporaryDirectory() as elsewhere:
            _install_and_run(archive, Path(elsewhere))
        print(f"{archive.name}: installs and runs")
    print(f"types: {100 * _typed_share():.1f} % of public names")


def _install_and_run(archive: Path, folder: Path) -> None:
    venv.create(folder / "env", with_pip=True)
    python = folder / "env" / "bin" / "python"
    quiet = ["--disable-pip-version-check", "--no-input", "-q"]
    subprocess.run([python, "-m", "pip", "install", *quiet, archive], cwd=folder, check=True)
    home = Path(_output([python, "-I", "-c", "import dqcontrol; print(dqcontrol.__file__)"], folder)).parent
    if folder not in home.parents:
        sys.exit(f"{archive.name}: the installed package was not the one imported, but {home}")
    for name in NEEDED:
        if not (home / name).exists():
            sys.exit(f"{archive.name}: {name} is missing")
    (folder / "spec.yaml").write_text(SPEC, encoding="utf-8")
    table = _output([python, "-I", "-m", "dqcontrol", "run", "spec.yaml", "--out", "results"], folder)
    if "proportional-feedforward · servo" not in table:
        sys.exit(f"{archive.name}: the demo printed no table:\n{table}")


def _output(command: list[str | Path], folder: Path) -> str:
    return subprocess.run(command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True).stdout.strip()


def _typed_share() -> float:
    command = ["pyright", "--verifytypes", "dqcontrol", "--ignoreexternal", "--outputjson"]
    tools = Path(sys.executable).parent
    command[0] = str(tools / "pyright")
    path = (
        f"{tools}{os.pathsep}{os.environ['PATH']}"  # pyright looks for the package by the first Python there
    )
    text = subprocess.run(
        command, stdout=subprocess.PIPE, text=True, check=False, env=os.environ | {"PATH": path}
    ).stdout
    completeness = json.loads(text)["typeCompleteness"]
    share = completeness["completenessScore"]
    if share < LEAST_TYPED:
        without = [
            each["name"] for each in completeness["symbols"] if each["isExported"] and not each["isTypeKnown"]
        ]
        sys.exit(f"types: {100 * share:.1f} % of public names; without are {', '.join(without[:20])} …")
    return share


if __name__ == "__main__":
    main()
