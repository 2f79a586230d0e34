"""Runs and studies read back from their folders."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import yaml
from msgspec import Meta

from dqcontrol.errors import Error, FileFormatError, unreadable
from dqcontrol.experiments.results_folder import SPEC_FILE, Row, read_rows
from dqcontrol.experiments.run import Run
from dqcontrol.experiments.spec import RobotSpec, read_data, read_spec
from dqcontrol.experiments.spec.reference_spec import Part
from dqcontrol.experiments.spec.spec_files import use_copies
from dqcontrol.experiments.study import ROWS, Study
from dqcontrol.files.input_file import read_text
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.loop import Record
from dqcontrol.recording import load_record


class EvaluationSpec(Part, frozen=True, kw_only=True):
    """What was evaluated, as ``spec.yaml`` of its results holds it; see `dqcontrol.logs.evaluate_log`."""

    log: str
    robot: RobotSpec
    reference: str | None = None
    reference_topic: str | None = None
    joints: list[str] | None = None
    joint_topic: str | None = None
    command_topic: str | None = None
    angles: Literal["rad", "deg"] | None = None
    reference_joints: str | list[str] | None = None
    missing: Literal["interpolate", "skip"] = "interpolate"
    align: bool = False
    start: Annotated[float, Meta(description="s")] = 0.0
    duration: Annotated[float, Meta(gt=0, description="s")] | None = None
    skip_initial: Annotated[float, Meta(ge=0, description="s")] = 0.0
    low_pass: Annotated[float, Meta(gt=0, description="Hz")] | None = None


class _SavedEvaluation(Part, frozen=True, kw_only=True):
    evaluation: EvaluationSpec


def saved_evaluation(spec: Path, record: Record) -> Run:
    """Return what `Run.save` has written of an evaluation: the content of ``spec.yaml`` and its record.

    Raises
    ------
    FileFormatError
        If the file is none of an evaluation.
    """
    text = read_text(spec)
    data = parse_yaml(spec, text)
    use_copies(data, spec.parent)
    what = convert(spec, data, _SavedEvaluation).evaluation
    robot = what.robot.load()
    return Run(text, robot, record, what.skip_initial, Path(what.log).stem, low_pass=what.low_pass)


def load_run(folder: str | Path) -> Run:
    """Return a saved run.

    Raises
    ------
    FileFormatError
        If the folder holds no run.
    """
    path = Path(folder)
    if not (path / SPEC_FILE).is_file() or not (path / "record.mcap").is_file():
        raise FileFormatError(why_no_run(path))
    text = spec_of_results(path)
    if "evaluation:" in text.splitlines():
        return saved_evaluation(path / SPEC_FILE, load_record(path / "record.mcap"))
    spec, _ = read_spec(path / SPEC_FILE)
    if not spec.is_single:
        raise FileFormatError(f"{path / SPEC_FILE}: describes several runs")
    (robot,), (law,), (plant,) = spec.robot_by_label.values(), spec.law_by_label, spec.plant_by_label
    record, label = load_record(path / "record.mcap"), f"{law} · {plant}"
    return Run(text, robot.load(), record, spec.skip_initial, label, spec.metrics_from)


def spec_of_results(folder: Path) -> str:
    """Return the text of ``spec.yaml`` in a folder of results, with copies for files that are not there any more."""
    text = read_text(folder / SPEC_FILE)
    data, plain = parse_yaml(folder / SPEC_FILE, text), parse_yaml(folder / SPEC_FILE, text)
    use_copies(data, folder)
    return text if data == plain else yaml.safe_dump(data, sort_keys=False, allow_unicode=True)


def why_no_run(path: Path) -> str:
    """Return why a folder is not that of a run, and what may have been meant."""
    if not path.exists():
        return str(unreadable(path, FileNotFoundError()))
    if path.suffix in (".yaml", ".yml"):
        return f"{path}: is a file, not the folder of a run; if it is an experiment: dqcontrol run {path}"
    if runs := [run.name for run in run_folders(path) if run != path]:
        return (
            f"{path}: is not the folder of a run, but holds runs: give {path / runs[0]}"
            + " or another" * (len(runs) > 1)
        )
    return f"{path}: is not the folder of a run ({SPEC_FILE} and record.mcap are missing or incomplete)"


def load_runs(folders: Sequence[str | Path]) -> dict[str, Run]:
    """Return saved runs by label; a folder of a study, or of its repeats, stands for all its runs.

    Labels name the study where there are several, or where two runs have one name.

    Raises
    ------
    FileFormatError
        If a folder holds no run.
    """
    found: list[tuple[str, str, Path]] = []
    seen: set[Path] = set()
    studies = 0
    for folder in map(Path, folders):
        inside = run_folders(folder)
        studies += inside != [folder]
        for path in inside:
            if path.resolve() in seen:
                raise Error(f"{path}: given twice")
            seen.add(path.resolve())
            name = f"{path.parent.name} · {path.name}" if path.name.isdecimal() else path.name
            study = path.resolve().parent if inside == [folder] else folder.resolve()
            found.append((study.name, name, path))
    plain = Counter(name for _, name, _ in found)
    full = Counter((study, name) for study, name, _ in found)
    runs: dict[str, Run] = {}
    for study, name, path in found:
        label = name if studies < 2 and plain[name] == 1 else f"{study} · {name}"
        runs[label if full[study, name] == 1 else str(path)] = load_run(path)
    return runs


def run_folders(folder: Path) -> list[Path]:
    """Return the folders of the runs that a folder holds, or the folder itself."""
    if (folder / "record.mcap").exists():
        return [folder]
    inner = [path.parent for path in folder.glob("*/record.mcap")]
    return sorted(inner, key=lambda path: (len(path.name) * path.name.isdecimal(), path.name)) or [folder]


def load_rows(folders: Sequence[str | Path]) -> list[Row]:
    """Return the trials of saved studies with ``runs.parquet``, and saved runs, as rows of one table.

    Returns
    -------
    Rows as those of a `Study`, and ``study``, its folder or empty; a run has its label for ``law``.

    Raises
    ------
    FileFormatError
        If a folder holds neither.
    Error
        If one is given twice.
    """
    rows: list[Row] = []
    names: dict[str, Path] = {}
    for folder in map(Path, folders):
        if not is_study(folder):
            continue
        if folder.resolve() in (path.resolve() for path in names.values()):
            raise Error(f"{folder}: given twice")
        name = folder.name if folder.name not in names else str(folder)
        names[name] = folder
        rows += [{"study": name, **row} for row in load_study(folder).rows]
    for label, run in load_runs([folder for folder in folders if not is_study(folder)]).items():
        place: Row = {"study": "", "robot": "", "law": label, "set": "", "plant": "", "repeat": 0, "seed": 0}
        rows.append({**place, "stopped": run.record.stopped, **run.metrics.flat()})
    return rows


def is_study(folder: str | Path) -> bool:
    """Tell whether a folder holds a study with ``runs.parquet``."""
    return (Path(folder) / ROWS).is_file()


def is_sweep(folder: str | Path) -> bool:
    """Tell whether a folder holds a parameter study."""
    return is_study(folder) and "sweep:" in read_text(Path(folder) / SPEC_FILE).splitlines()


def load_study(folder: str | Path) -> Study:
    """Return a saved study with the rows of its trials, without their records.

    Raises
    ------
    FileFormatError
        If the folder holds no study with ``runs.parquet``.
    MissingExtraError
        If pyarrow is not installed.
    """
    path = Path(folder)
    for name in (SPEC_FILE, ROWS):
        if not (path / name).is_file():
            raise FileFormatError(f"{path}: is not the folder of a study with metrics ({name} is missing)")
    _, data, _ = read_data(path / SPEC_FILE)
    return Study(str(data["name"]), spec_of_results(path), {}, read_rows(path / ROWS))
