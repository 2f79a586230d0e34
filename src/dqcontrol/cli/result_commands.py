"""Compare, look at, draw and film what was run."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from dqcontrol.cli.options import ANGLES, Force, Out, Port, ReplaceResults, Switch, in_unit
from dqcontrol.cli.screen import announce, print_found, progress_bar

if TYPE_CHECKING:
    from dqcontrol.browser import GrowingRecording, LiveRun, Track
    from dqcontrol.experiments import Run


def compare(
    *folders: Path,
    out: Out = None,
    force: ReplaceResults = False,
    by: str | None = None,
    where: tuple[str, ...] = (),
    best_per: str | None = None,
) -> None:
    """Compare saved runs: one table; with --out plots and a report. Of studies with repeats, a table of means.

    Of parameter studies (sweeps), and of studies with --by, the table lists the best points.

    Parameters
    ----------
    folders
        Folders of runs, or of studies for all their runs.
    out
        New folder for table and plots.
    by
        Number that says which points are best, as in runs.parquet; default for sweeps: error.integral.
    where
        Only points with this value of a parameter or label: plant.delay=0.032 or plant.delay=32ms; again for more.
    best_per
        List the best point for each value of this parameter or label, as plant.delay.
    """
    from dqcontrol.errors import Error
    from dqcontrol.experiments import load_rows, load_runs, rank, summary
    from dqcontrol.experiments.load_results import is_study, is_sweep
    from dqcontrol.experiments.ranking import BEST_BY
    from dqcontrol.experiments.results_folder import SPEC_FILE, new_folder
    from dqcontrol.experiments.run_comparison import MEANS, write_table
    from dqcontrol.measures import means_table
    from dqcontrol.reports import write_report
    from dqcontrol.reports.about import RERUN_FOLDER, command, origins
    from dqcontrol.reports.study_reports import figures_of_runs

    if not folders:
        raise Error("compare: give at least one folder of a run")
    if by is not None or where or best_per or any(map(is_sweep, folders)):
        ranking = rank(folders, by or BEST_BY, dict(map(_condition, where)))
        runs, table = {}, (ranking.best_of_each(best_per) if best_per else ranking).table()
    elif any(map(is_study, folders)):
        runs, table = {}, means_table(load_rows(folders), MEANS, "comparison")
    else:
        runs = load_runs(folders)
        table = summary(runs, "comparison")
    if out is not None:
        with new_folder(out, force=force) as new:
            (new / SPEC_FILE).write_text("".join(f"# {folder}\n" for folder in folders), encoding="utf-8")
            write_table(table, new, "table")
            places = [str(folder.resolve()) for folder in folders]
            write_report(
                new,
                "Comparison",
                facts=", ".join(map(str, folders)),
                command=command("compare", *places, by=by, where=where, best_per=best_per, out=RERUN_FOLDER),
                tables=[table],
                figures=figures_of_runs(runs),
                origins=origins({}),
            )
    print_found(table, folder=out)


def _condition(text: str) -> tuple[str, float | str]:
    """Return the key and the value, in SI units, of what ``--where`` says."""
    from dqcontrol.errors import Error
    from dqcontrol.files.units import as_quantity

    key, equals, value = text.partition("=")
    if not (key and equals and value):
        raise Error(f"where: expected KEY=VALUE, as plant.delay=0.032, got '{text}'")
    if quantity := as_quantity(value):
        return key, quantity[0]
    try:
        return key, float(value)
    except ValueError:
        return key, value


def view(*runs: Path, live: Path | None = None, save: Path | None = None, port: Port = 8080) -> None:
    """Look at runs in a browser: robots, paths, frames, errors and limits over time; Ctrl+C ends it.

    Parameters
    ----------
    runs
        Folders of runs, also of those in progress, or of studies for all their runs; or recordings (.mcap).
    live
        A spec of one run, which is run in real time meanwhile and not saved.
    save
        Write a page (.html) that plays the runs without this program, in place of looking at them.
    port
        Of this machine, where only its own users reach it; the next free one if it is taken.
    """
    from dqcontrol.browser import LiveRun, Page, Track, growing_recording
    from dqcontrol.browser.served_page import import_viser
    from dqcontrol.errors import Error
    from dqcontrol.experiments import load_runs

    if not runs and live is None:
        raise Error("view: give at least one folder of a run, a recording, or --live SPEC")
    import_viser()  # before the work: it may be missing
    recordings = {path: file for path in runs if (file := growing_recording(path))}
    saved = load_runs([path for path in runs if path not in recordings])
    tracks = [Track.of_run(label, run) for label, run in saved.items()]
    if save is not None:
        _save(saved, save, recordings or live)
        return
    running = LiveRun(live) if live is not None else None
    try:
        growing = [_follow(file, str(path), tracks) for path, file in recordings.items()]
        if running is not None:
            growing.append(_follow_run(running, tracks))
        title = " · ".join(track.label for track in tracks[:3])
        page = Page(tracks, port, (lambda: _take_news(growing, running)) if growing else None, title)
        announce("view", page.url)
        page.serve()
    finally:
        if running is not None:
            running.close()


def _save(runs: Mapping[str, Run], path: Path, in_progress: object) -> None:
    """Write a page that plays saved runs."""
    from dqcontrol.browser.replay import replay_of_runs
    from dqcontrol.errors import ExistsError, ValueRangeError, writing

    if in_progress:
        raise ValueRangeError(
            "save: takes folders of runs that are over; one in progress, or a recording, is shown without it"
        )
    if path.suffix != ".html":
        raise ValueRangeError(f"save: expected the name of a page, .html, got '{path}'")
    if path.exists():
        raise ExistsError(f"{path}: exists already; choose another name or remove it")
    page = replay_of_runs(runs)
    with writing(path):
        path.write_text(page, encoding="utf-8")
    print(f"view: {path} ({len(page.encode()) / 1e6:.1f} MB)")


def _follow(path: Path, label: str, tracks: list[Track]) -> tuple[GrowingRecording, Track]:
    """Add the track of a recording that may grow."""
    from dqcontrol.browser import GrowingRecording, Track
    from dqcontrol.errors import ValueRangeError
    from dqcontrol.experiments.spec import RobotSpec
    from dqcontrol.files.yaml_file import convert
    from dqcontrol.logs.evaluation import about_log
    from dqcontrol.recording import load_metadata

    load_metadata(path)  # or say that it is none
    about = about_log(path)
    if "robot" not in about:
        raise ValueRangeError(
            f"{path}: does not name its robot; write it with a spec, at least 'robot: NAME'"
        )
    robot = convert(path, about["robot"], RobotSpec).load()
    growing = GrowingRecording(path, robot)
    tracks.append(Track(label, robot, growing.first()))
    return growing, tracks[-1]


def _follow_run(running: LiveRun, tracks: list[Track]) -> tuple[GrowingRecording, Track]:
    """Add the track of a run in progress here."""
    from dqcontrol.browser import GrowingRecording, Track
    from dqcontrol.errors import Error

    growing = GrowingRecording(running.path, running.robot)
    try:
        first = growing.first()
    except Error as error:
        raise running.failure or error from None
    tracks.append(Track(running.label, running.robot, first, running.planned, running.constraints))
    return growing, tracks[-1]


def _take_news(growing: list[tuple[GrowingRecording, Track]], running: LiveRun | None) -> bool:
    """Give tracks their new samples; tell whether any recording still grows."""
    if running is not None and running.failure is not None:
        raise running.failure
    goes_on = [recording.goes_on for recording, _ in growing]  # before the last look
    for recording, track in growing:
        record = recording.record()
        if record is not None:
            track.take(record)
    return any(goes_on)


def report(*folders: Path, jobs: int | None = None) -> None:
    """Regenerate the reports of saved runs, with all figures, which studies leave out, and replays that move.

    Parameters
    ----------
    folders
        Folders of runs, or of studies for all their runs.
    jobs
        Processes that draw in parallel; default: as many as there are processors, if there is enough to do.
    """
    from dqcontrol.errors import Error
    from dqcontrol.reports import rewrite_reports

    if not folders:
        raise Error("report: give at least one folder of a run or a study")
    with progress_bar() as progress:
        written = rewrite_reports(folders, jobs=jobs, progress=partial(progress, label="reports"))
    for path in written:
        print(path)


def figures(
    *folders: Path,
    formats: Annotated[tuple[Literal["pdf", "png", "svg"], ...], Parameter(name="--format")] = ("pdf",),
    width: Literal["single", "double"] = "double",
    out: Out = None,
    force: Force = False,
) -> None:
    """Draw the figures of saved results for papers: of one run, of several together, of repeats or of a sweep.

    Parameters
    ----------
    folders
        Folders of runs or studies.
    formats
        pdf, svg or png (300 dots an inch); give the option again for several.
    width
        One (single, 3.5 in) or both columns (double, 7.16 in) of a journal's page.
    out
        New folder; default: figures.
    force
        Replace an earlier folder of figures.
    """
    from dqcontrol.errors import Error
    from dqcontrol.experiments.results_folder import check_new, new_folder
    from dqcontrol.figures import column_width, save_figures
    from dqcontrol.figures.save import PAPER_DPI
    from dqcontrol.reports.redrawn import figures_of_results

    if not folders:
        raise Error("figures: give at least one folder of a run or a study")
    folder = out or Path("figures")
    check_new(folder, force=force)
    with column_width(width):
        drawn = figures_of_results(folders)
    with new_folder(folder, force=force) as new:
        save_figures(drawn, new, formats, PAPER_DPI)
    print(f"results: {folder}")
    print(", ".join(drawn))


def clip(
    *runs_and_path: Path,
    force: Annotated[Switch, Parameter(help="Replace an existing file.")] = False,
    faster: Annotated[float, Parameter(metavar="<times>")] = 1.0,
    rate: Annotated[float, in_unit("Hz", "25Hz")] = 25.0,
    size: Annotated[str, Parameter(metavar="<pixels>")] = "640x480",
    azimuth: Annotated[float | None, ANGLES] = None,
    elevation: Annotated[float | None, ANGLES] = None,
) -> None:
    """Save a clip or a picture of a run, or of several of one robot in one scene: arms, and mobile manipulators.

    Parameters
    ----------
    runs_and_path
        Folders of runs, and the new file: .mp4, .webp or .gif; or .png, one picture of the whole run. The second run
        and further ones show through the first.
    faster
        Of a clip: how much faster than it was.
    rate
        Of a clip: frames a second.
    size
        Width and height of the picture or of each frame.
    azimuth
        Direction of view, rad or as 60deg.
    elevation
        Direction of view, rad or as -25deg; negative looks down.
    """
    from dqcontrol.errors import FileFormatError, ValueRangeError
    from dqcontrol.experiments import load_run
    from dqcontrol.films.clip import CLIPS, render_clip, render_whole

    pixels = re.fullmatch(r"(\d+)x(\d+)", size)
    if not pixels:
        raise ValueRangeError(f"--size: expected width and height in pixels, as 640x480, got '{size}'")
    if len(runs_and_path) < 2:
        raise ValueRangeError(
            "clip: expected the folder of a run, or several, and a file: dqcontrol clip RUN run.webp"
        )
    *folders, path = runs_and_path
    if path.suffix.lower() not in (endings := (".png", *CLIPS)):
        raise FileFormatError(f"{path}: must end in {', '.join(endings)}, got '{path.suffix}'")
    first, *others = (load_run(folder) for folder in folders)
    for folder, other in zip(folders[1:], others, strict=True):
        if other.robot.name != first.robot.name:
            raise ValueRangeError(
                f"{folder}: is of {other.robot.name}, and the first run of {first.robot.name}"
            )
    look: dict[str, Any] = {
        "width": int(pixels[1]),
        "height": int(pixels[2]),
        "azimuth": None if azimuth is None else math.degrees(azimuth),
        "elevation": None if elevation is None else math.degrees(elevation),
        "overwrite": force,
        "kept": first.surroundings,
        "further": [(other.plant, other.record) for other in others],
        "labels": [folder.name for folder in folders] if others else (),
    }
    if path.suffix.lower() == ".png":
        render_whole(first.robot, first.plant, first.record, path, **look)
    else:
        with progress_bar() as progress:
            render_clip(
                first.robot,
                first.plant,
                first.record,
                path,
                speed=faster,
                rate=rate,
                progress=partial(progress, label="frames"),
                **look,
            )
    print(f"results: {path}")
