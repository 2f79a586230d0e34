"""Write the signals of a run, or a world, for other programs."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.cli.options import Force

_WORLDS = (".yaml", ".yml", ".xml", ".urdf", ".scene")
_MAPS = (".pgm", ".png")


def convert(run: Path, file: Path, /, *, force: Force = False) -> None:
    """Write all signals of a run, or a world, for other programs.

    Parameters
    ----------
    run
        Folder of a run; or the file of a world: .yaml, .xml (MJCF), .urdf or .scene (MoveIt).
    file
        New file; its suffix chooses the format: of signals .csv, .parquet or .mat, of worlds those above, or .pgm and
        .png: a map of the floor for ROS's map server, with its .yaml beside it.
    force
        Replace an existing file.
    """
    from dqcontrol.errors import ExistsError, ShapeError, writing
    from dqcontrol.experiments import load_run
    from dqcontrol.experiments.spec.world_file import load_world, world_text
    from dqcontrol.files.whole_file import whole_file
    from dqcontrol.geometry import save_map
    from dqcontrol.world import floor_around

    if run.is_file() and file.suffix.lower() in _MAPS:
        if file.with_suffix(".yaml").resolve() == run.resolve():
            raise ExistsError(f"{file}: its .yaml would be {run} itself; choose another name")
        floor = floor_around(load_world(run), "all", "world")
        print(f"results: {file}, {save_map(floor, file, force=force)}")
        return
    if run.is_file() and file.suffix.lower() in _WORLDS:
        text = world_text(load_world(run), file.suffix.lower())
        if file.exists() and not force:
            raise ExistsError(f"{file}: exists already; give --force to replace it")
        with writing(file), whole_file(file, overwrite=force) as draft:
            draft.write_text(text, encoding="utf-8")
        print(f"results: {file}")
        return
    if run.is_file():
        raise ShapeError(
            f"{run}: is a file; signals are those of a run, whose folder dqcontrol run writes; "
            f"a controller in C: dqcontrol export {run} --out FOLDER"
        )
    print(f"results: {load_run(run).export(file, force=force)}")
