"""LeRobot datasets of version 3.0, written and read with pyarrow alone: plain arrays by the names of their columns.

By hand, although there is a library: lerobot needs PyTorch (5 GB), and what is needed of it here are four files. Their
layout is that of ``lerobot/datasets`` of release 0.6, which the slow tests read them with.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import (
    ExistsError,
    FileFormatError,
    ShapeError,
    ValueRangeError,
    from_extra,
    writing,
)

VERSION = "v3.0"
STATE, ACTION = "observation.state", "action"
POSE, COMMAND, REFERENCE = "observation.pose", "command", "reference.pose"  # ours beside lerobot's names
_INFO, _TASKS, _STATS = "meta/info.json", "meta/tasks.parquet", "meta/stats.json"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"  # a field that readers expect
_FILES_A_CHUNK, _LARGEST_FILE, _LARGEST_VIDEO = 1000, 100, 200  # lerobot's: files, MB, MB
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_COUNTED = {"timestamp": "float32"}
_COUNTED |= dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")


class Feature(NamedTuple):
    """A column of numbers: the names of its parts, and their units."""

    names: tuple[str, ...]
    units: tuple[str, ...]


class Episode(NamedTuple):
    """One motion: what was to be done, and the values (N, parts) of each feature."""

    task: str
    values: Mapping[str, Array]


def whole_rate(time: Array) -> int:
    """Return how many samples there are in a second, which a dataset needs to be a whole number.

    Raises
    ------
    ValueRangeError
        If the steps differ, or their rate is no whole number.
    """
    steps = np.diff(time)
    if not len(steps):
        raise ValueRangeError("fps: needs at least two samples")
    rate = 1.0 / float(np.median(steps))
    whole = max(round(rate), 1)
    # Half a step over the whole motion: then each frame is nearer to its own sample than to another.
    if np.abs(time - time[0] - np.arange(len(time)) / whole).max() > 0.5 / whole:
        raise ValueRangeError(
            f"fps: the samples come at {rate:.6g} a second or at varying times, and a dataset needs a whole number; "
            f"give one, as --fps {whole}"
        )
    return whole


def write_dataset(
    folder: str | Path,
    fps: int,
    features: Mapping[str, Feature],
    episodes: Sequence[Episode],
    *,
    robot_type: str = "",
    force: bool = False,
) -> Path:
    """Write a dataset; the folder appears whole or not at all.

    Parameters
    ----------
    folder
        A new one.
    fps
        Frames a second.
    features
        The columns: ``observation.state`` and ``action`` are what policies learn from.
    episodes
        Motions with all of these columns.
    robot_type
        Name of the robot.
    force
        Replace an earlier folder.

    Raises
    ------
    ExistsError
        If the folder exists, without ``force``, or is no dataset.
    MissingExtraError
        If pyarrow is not installed.
    ShapeError
        If an episode lacks a column, or has columns of different lengths.

    Examples
    --------
    >>> import tempfile, numpy as np
    >>> folder = tempfile.mkdtemp() + "/swing"
    >>> features = {"observation.state": Feature(("hinge.pos",), ("rad",))}
    >>> _ = write_dataset(folder, 10, features, [Episode("swing", {"observation.state": np.zeros((5, 1))})])
    >>> read_dataset(folder).episode(0)["observation.state"].shape
    (5, 1)
    """
    folder = Path(folder)
    arrow, parquet = map(_library, ("pyarrow", "pyarrow.parquet"))
    if folder.exists() and not (force and (folder / _INFO).is_file()):
        hint = "is no dataset" if force else "exists"
        raise ExistsError(f"{folder}: {hint}; choose another name" + ", or --force replaces it" * (not force))
    for episode in episodes:
        _check(features, episode)
    draft = folder.with_name(f".{os.getpid()}.{folder.name}")
    with writing(folder):
        try:
            _write(draft, fps, features, episodes, robot_type, arrow, parquet)
            if folder.exists():
                shutil.rmtree(folder)
            draft.rename(folder)
        finally:
            shutil.rmtree(draft, ignore_errors=True)
    return folder


def _check(features: Mapping[str, Feature], episode: Episode) -> None:
    count = len(next(iter(episode.values.values()))) if episode.values else 0
    if not count:
        raise ShapeError(f"episode '{episode.task}': has no samples")
    for name, feature in features.items():
        shape = np.shape(episode.values.get(name, ()))
        if shape != (count, len(feature.names)):
            raise ShapeError(
                f"episode '{episode.task}': {name}: expected shape {(count, len(feature.names))}, got {shape}"
            )


def _write(
    folder: Path,
    fps: int,
    features: Mapping[str, Feature],
    episodes: Sequence[Episode],
    robot_type: str,
    arrow: Any,
    parquet: Any,
) -> None:
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    types = {name: _type(arrow, len(feature.names)) for name, feature in features.items()}
    types |= {name: getattr(arrow, kind)() for name, kind in _COUNTED.items()}
    schema = arrow.schema(types)
    rows: list[dict[str, Any]] = []
    every: list[dict[str, dict[str, list[float]]]] = []
    file, first, writer, path = -1, 0, None, folder
    try:
        for number, episode in enumerate(episodes):
            if writer is None or path.stat().st_size > _LARGEST_FILE << 20:
                if writer is not None:
                    writer.close()
                file += 1
                path = folder / _place(file)
                path.parent.mkdir(parents=True, exist_ok=True)
                writer = parquet.ParquetWriter(path, schema, compression="snappy")
            columns = _columns(episode, number, first, tasks.index(episode.task), fps)
            count = len(columns["index"])
            table = [_cells(arrow, columns[name], types[name]) for name in schema.names]
            writer.write_table(arrow.table(table, schema=schema))  # one row group an episode
            every.append({name: _statistics(values) for name, values in columns.items()})
            row = {
                "episode_index": number,
                "tasks": [episode.task],
                "length": count,
                "data/chunk_index": file // _FILES_A_CHUNK,
                "data/file_index": file % _FILES_A_CHUNK,
                "dataset_from_index": first,
                "dataset_to_index": first + count,
            }
            for name, each in every[-1].items():
                row |= {f"stats/{name}/{key}": value for key, value in each.items()}
            rows.append(row | {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0})
            first += count
    finally:
        if writer is not None:
            writer.close()
    (folder / _EPISODES).parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(arrow.Table.from_pylist(rows), folder / _EPISODES)
    parquet.write_table(_task_table(arrow, tasks), folder / _TASKS)
    described = {
        name: {"dtype": "float32", "shape": [len(each.names)], "names": [*each.names], "units": [*each.units]}
        for name, each in features.items()
    }
    counted = {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in _COUNTED.items()}
    info = {
        "codebase_version": VERSION,
        "robot_type": robot_type,
        "total_episodes": len(episodes),
        "total_frames": first,
        "total_tasks": len(tasks),
        "chunks_size": _FILES_A_CHUNK,
        "data_files_size_in_mb": _LARGEST_FILE,
        "video_files_size_in_mb": _LARGEST_VIDEO,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": _DATA,
        "video_path": _VIDEO,
        "features": {**described, **counted},
    }
    (folder / _INFO).write_text(json.dumps(info, indent=4, ensure_ascii=False), encoding="utf-8")
    (folder / _STATS).write_text(json.dumps(_overall(every), indent=4), encoding="utf-8")


def _place(file: int) -> str:
    return _DATA.format(chunk_index=file // _FILES_A_CHUNK, file_index=file % _FILES_A_CHUNK)


def _type(arrow: Any, count: int) -> Any:
    """Return the type of a column: lists of numbers, or numbers where there is one part."""
    return arrow.float32() if count == 1 else arrow.list_(arrow.float32(), count)


def _cells(arrow: Any, values: NDArray[np.generic], kind: Any) -> Any:
    flat = np.ascontiguousarray(values).ravel()
    if not arrow.types.is_fixed_size_list(kind):
        return arrow.array(flat.astype(kind.to_pandas_dtype()), kind)
    return arrow.FixedSizeListArray.from_arrays(arrow.array(flat.astype(np.float32)), kind.list_size)


def _columns(
    episode: Episode, number: int, first: int, task: int, fps: int
) -> dict[str, NDArray[np.generic]]:
    count = len(next(iter(episode.values.values())))
    frames = np.arange(count)
    return {
        **{name: np.asarray(values, float) for name, values in episode.values.items()},
        "timestamp": (frames / fps)[:, None],
        "frame_index": frames[:, None],
        "episode_index": np.full((count, 1), number),
        "index": first + frames[:, None],
        "task_index": np.full((count, 1), task),
    }


def _statistics(values: NDArray[Any]) -> dict[str, Any]:
    found = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    found |= {name: np.quantile(values, level, axis=0) for name, level in _QUANTILES.items()}
    return {name: each.tolist() for name, each in found.items()} | {"count": [len(values)]}


def _overall(
    every: Sequence[Mapping[str, Mapping[str, Sequence[float]]]],
) -> dict[str, dict[str, list[float]]]:
    """Return the statistics of all episodes; quantiles as lerobot joins them: means weighted by samples."""
    out: dict[str, dict[str, list[float]]] = {}
    for name in every[0] if every else ():
        parts = {key: np.array([each[name][key] for each in every], float) for key in every[0][name]}
        weights = parts["count"] / parts["count"].sum()
        mean = (weights * parts["mean"]).sum(0)
        spread = np.sqrt((weights * (parts["std"] ** 2 + (parts["mean"] - mean) ** 2)).sum(0))
        joined = {"min": parts["min"].min(0), "max": parts["max"].max(0), "mean": mean, "std": spread}
        joined |= {key: (weights * parts[key]).sum(0) for key in _QUANTILES}
        out[name] = {key: value.tolist() for key, value in joined.items()}
        out[name]["count"] = [int(parts["count"].sum())]
    return out


def _task_table(arrow: Any, tasks: Sequence[str]) -> Any:
    """Return the table of tasks: readers expect their texts as the index of a pandas frame."""
    kinds = (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy_kind, "metadata": None}
        for name, kind, numpy_kind in kinds
    ]
    about = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    table = arrow.table({"task_index": arrow.array(range(len(tasks)), arrow.int64()), "task": list(tasks)})
    return table.replace_schema_metadata({"pandas": json.dumps(about)})


class Dataset:
    """A dataset that was read.

    Attributes
    ----------
    folder
        Where it is.
    fps
        Frames a second.
    features
        Its columns of numbers by name; units are empty where the dataset tells none.
    tasks
        What each episode was to do.
    """

    def __init__(self, folder: Path, info: Mapping[str, Any]) -> None:
        self.folder = folder
        try:
            self.fps = int(info["fps"])
            self.features = {
                name: _feature(about)
                for name, about in info["features"].items()
                if name not in _COUNTED and str(about["dtype"]).startswith(("float", "int"))
            }
            self._data = str(info.get("data_path", _DATA))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise FileFormatError(f"{folder / _INFO}: is malformed: {type(error).__name__} {error}") from None
        if self.fps < 1:
            raise FileFormatError(f"{folder / _INFO}: fps: must be ≥ 1, got {self.fps}")
        self._episodes = self._table(
            sorted(folder.glob("meta/episodes/*/*.parquet")),
            ["episode_index", "tasks", "length", "data/chunk_index", "data/file_index"],
        )

    @property
    def count(self) -> int:
        """How many episodes it has."""
        return len(self._episodes["episode_index"])

    @property
    def tasks(self) -> tuple[str, ...]:
        """What each episode was to do."""
        return tuple("; ".join(each) for each in self._episodes["tasks"])

    def check(self, number: int) -> None:
        """Raise `ValueRangeError` if there is no such episode."""
        if not 0 <= number < self.count:
            raise ValueRangeError(
                f"{self.folder}: has {self.count} episodes, 0 to {self.count - 1}; got {number}"
            )

    def episode(self, number: int) -> dict[str, Array]:
        """Return the values (N, parts) of each feature in an episode, and its ``timestamp`` (N, 1), s.

        Raises
        ------
        ValueRangeError
            If there is no such episode.
        FileFormatError
            If its file is missing or malformed, or a number is not finite.
        """
        self.check(number)
        chunk, file = (int(self._episodes[f"data/{each}_index"][number]) for each in ("chunk", "file"))
        path = self.folder / self._data.format(chunk_index=chunk, file_index=file)
        wanted = int(self._episodes["episode_index"][number])
        names = ["timestamp", *self.features]
        table = self._table([path], names, filters=[("episode_index", "=", wanted)])
        out: dict[str, Array] = {}
        for name in names:
            try:
                values = np.array(table[name], float).reshape(len(table["timestamp"]), -1)
            except (TypeError, ValueError):
                raise FileFormatError(f"{path}: {name}: expected rows of equal length") from None
            if not np.isfinite(values).all():
                raise FileFormatError(f"{path}: {name}: must be finite in episode {number}")
            out[name] = values
        return out

    def _table(self, paths: Iterable[Path], columns: Sequence[str], **options: Any) -> dict[str, list[Any]]:
        arrow, parquet = map(_library, ("pyarrow", "pyarrow.parquet"))
        found: dict[str, list[Any]] = {name: [] for name in columns}
        for path in paths:
            try:
                table = parquet.read_table(path, columns=list(columns), **options)
                for name in columns:
                    found[name] += table.column(name).to_pylist()
            except (OSError, KeyError, arrow.ArrowException) as error:
                why = " ".join(str(error).split()) or type(error).__name__
                raise FileFormatError(f"{path}: cannot be read: {why:.200}") from None
        return found


def is_dataset(folder: Path) -> bool:
    """Return whether a folder is a LeRobot dataset of any version."""
    return (folder / _INFO).is_file()


def episode_of(path: str | os.PathLike[str]) -> tuple[Dataset, int | None] | None:
    """Return the dataset that ``FOLDER`` or ``FOLDER:EPISODE`` names, and the number; None if it names none.

    Raises
    ------
    FileFormatError, MissingExtraError
        As for `read_dataset`.
    ValueRangeError
        If there is no such episode.
    """
    text = os.fspath(path)
    folder, _, number = text.rpartition(":")
    if is_dataset(Path(text)):
        return read_dataset(text), None
    if not (folder and number.isdecimal() and is_dataset(Path(folder))):
        return None
    found = read_dataset(folder)
    found.check(int(number))
    return found, int(number)


def episode_paths(path: Path) -> list[Path]:
    """Return ``FOLDER:0``, … for each episode of a dataset; any other path alone."""
    data, number = episode_of(path) or (None, None)
    if data is None or number is not None or data.count == 1:
        return [path]
    return [Path(f"{path}:{i}") for i in range(data.count)]


def only_episode(path: str | os.PathLike[str], data: Dataset, number: int | None) -> int:
    """Return which episode is meant.

    Raises
    ------
    ValueRangeError
        If there are several and none was named.
    """
    if number is None and data.count != 1:
        raise ValueRangeError(f"{path}: has {data.count} episodes; name one, as {path}:0")
    return number or 0


def read_dataset(folder: str | Path) -> Dataset:
    """Read what a dataset holds; its episodes are read when they are asked for.

    Raises
    ------
    FileFormatError
        If it is none, malformed, or of another version.
    MissingExtraError
        If pyarrow is not installed.
    """
    folder = Path(folder)
    try:
        info = json.loads((folder / _INFO).read_text(encoding="utf-8"))
        version = str(info["codebase_version"])
    except (OSError, UnicodeDecodeError):
        raise FileFormatError(f"{folder}: is no LeRobot dataset ({_INFO} is missing)") from None
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(f"{folder / _INFO}: is malformed: {type(error).__name__} {error}") from None
    if version.split(".")[0] != VERSION.split(".")[0]:
        raise FileFormatError(
            f"{folder}: is a LeRobot dataset of version {version}, and {VERSION} is read; "
            "lerobot's own scripts convert older ones"
        )
    return Dataset(folder, info)


def _feature(about: Mapping[str, Any]) -> Feature:
    (size,) = about["shape"] if len(about["shape"]) == 1 else (int(np.prod(about["shape"])),)
    names = about.get("names")
    if isinstance(names, dict):  # some datasets group them: {"motors": [...]}
        names = [each for group in names.values() for each in group]
    if not names or len(names) != size:
        names = [str(i) for i in range(size)]
    units = about.get("units") or [""] * size
    return Feature(tuple(map(str, names)), tuple(map(str, units)))


def _library(module: str) -> Any:
    return from_extra(module, "lerobot", "LeRobot datasets")
