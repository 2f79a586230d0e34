"""Several laws on several plants: all runs of one spec, their table and plots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dqcontrol.errors import Error, FileFormatError
from dqcontrol.experiments.evaluation import saved_evaluation
from dqcontrol.experiments.output import MARK, folder_names, new_folder
from dqcontrol.experiments.run import Run, prepare, run_one
from dqcontrol.experiments.spec import RobotSpec, read_spec, spec_text
from dqcontrol.experiments.tables import Column, Table
from dqcontrol.loop import load_record
from dqcontrol.robots import load_robot
from dqcontrol.yaml_file import read_text

COMPARED = {  # keys of `Metrics.flat`; errors without the start that the spec excludes
    "position.settled_mean": Column("mean", "mm", ".3g"),
    "position.settled_rms": Column("RMS", "mm", ".3g"),
    "position.settled_peak": Column("max", "mm", ".3g"),
    "orientation.settled_rms": Column("RMS", "°", ".3g"),
    "orientation.settled_peak": Column("max", "°", ".3g"),
    "effort": Column("effort", "rad/√s", ".3g"),
    "control.peak": Column("peak |u|", "rad/s", ".3g"),
    "hand_speed.peak": Column("peak speed", "m/s", ".3g"),
    "hand_acceleration.peak": Column("peak acc.", "m/s²", ".3g"),
    "limit_margin": Column("limit margin", "rad", ".3g"),
}

StudyProgress = Callable[[str, int, int], None]  # label, steps done, steps in all


@dataclass(frozen=True)
class Study:
    """The runs of a spec with several laws or plants.

    Attributes
    ----------
    name
        Of the spec.
    spec
        Its YAML text with all defaults.
    runs
        By label: law and plant.
    """

    name: str
    spec: str
    runs: dict[str, Run]

    def table(self) -> Table:
        """Return one row a run."""
        return summary(self.runs, self.name)

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write a folder a run, ``table.md``, ``table.csv``, ``spec.yaml`` and comparison plots.

        Parameters
        ----------
        folder
            A new folder.
        force
            Replace it, if it holds earlier results.

        Raises
        ------
        ExistsError
            If the folder exists (and holds no results, with ``force``).
        """
        with new_folder(folder, force=force) as new:
            (new / MARK).write_text(self.spec, encoding="utf-8")
            names = folder_names(self.runs)
            for label, run in self.runs.items():
                inner = new / names[label]
                inner.mkdir()
                run.write(inner)
            write_comparison(self.runs, new, self.name)
        return Path(folder)


def run_study(source: str | Path | dict[str, Any], *, progress: StudyProgress | None = None) -> Study:
    """Run every law of a spec on every plant of it.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary; see `dqcontrol.experiments.Spec`.
    progress
        Called with the run's label, its steps done and its steps in all.

    Raises
    ------
    dqcontrol.Error
        If something is missing, malformed, does not fit or is out of reach; before anything moves.
    """
    setting = prepare(source)
    spec = setting.spec
    folder_names(f"{law} · {plant}" for plant in spec.plant_by_label for law in spec.law_by_label)
    runs = {}
    for plant in setting.spec.plant_by_label:
        for law in setting.spec.law_by_label:
            label = f"{law} · {plant}"
            if progress:
                progress(label, 0, len(setting.samples))
            step = (lambda done, total, label=label: progress(label, done, total)) if progress else None
            runs[label] = run_one(setting, law, plant, progress=step)
            if progress:
                progress(label, len(setting.samples), len(setting.samples))
    return Study(setting.spec.name, spec_text(setting.spec, setting.folder), runs)


def summary(runs: Mapping[str, Run], title: str = "") -> Table:
    """Return one row a run; errors in mm and degrees are those after the start that the spec excludes."""
    rows = []
    for label, run in runs.items():
        flat = run.metrics.flat()
        rows.append([label, *(flat[key] for key in COMPARED), run.record.stopped])
    return Table([Column("run"), *COMPARED.values(), Column("ended by")], rows, title)


def load_run(folder: str | Path) -> Run:
    """Return a saved run.

    Raises
    ------
    FileFormatError
        If the folder holds no run.
    """
    path = Path(folder)
    if not (path / MARK).is_file() or not (path / "record.mcap").is_file():
        raise FileFormatError(
            f"{path}: is no folder of a run ({MARK} and record.mcap are missing or incomplete)"
        )
    text = read_text(path / MARK)
    if "evaluation:" in text.splitlines():
        return saved_evaluation(path / MARK, load_record(path / "record.mcap"))
    spec, _ = read_spec(path / MARK)
    if not spec.is_single:
        raise FileFormatError(f"{path / MARK}: has several laws or plants; a run has one of each")
    robot = spec.robot if isinstance(spec.robot, RobotSpec) else RobotSpec(source=spec.robot)
    (law,), (plant,) = spec.law_by_label, spec.plant_by_label
    return Run(
        text,
        load_robot(robot.source, robot.base_link, robot.tip_link),
        load_record(path / "record.mcap"),
        spec.settle,
        f"{law} · {plant}",
    )


def load_runs(folders: list[Path]) -> dict[str, Run]:
    """Return saved runs by label; a folder of a study stands for all its runs.

    Raises
    ------
    FileFormatError
        If a folder holds no run.
    """
    runs: dict[str, Run] = {}
    seen: set[Path] = set()
    for folder in folders:
        inner = sorted(path.parent for path in folder.glob("*/record.mcap"))
        for path in inner if inner and not (folder / "record.mcap").exists() else [folder]:
            if path.resolve() in seen:
                raise Error(f"{path}: given twice")
            seen.add(path.resolve())
            label = path.name if path.name not in runs else str(path)
            runs[label] = load_run(path)
    return runs


def write_comparison(runs: Mapping[str, Run], folder: Path, title: str) -> None:
    """Write table and comparison plots of several runs into an existing folder."""
    from dqcontrol.view import save_comparison

    table = summary(runs, title)
    (folder / "table.md").write_text(table.markdown(), encoding="utf-8")
    (folder / "table.csv").write_text(table.csv(), encoding="utf-8")
    save_comparison({label: run.record for label, run in runs.items()}, folder)
