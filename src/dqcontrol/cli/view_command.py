"""Look at runs in a browser."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.cli.options import Port

if TYPE_CHECKING:
    from dqcontrol.browser import GrowingRecording, LiveRun, Track
    from dqcontrol.experiments import Run


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
    tracks = [
        Track(label, run.robot, run.record, constraints=run.surroundings) for label, run in saved.items()
    ]
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


def announce(command: str, url: str) -> None:
    """Say where a page is, and open the browser there."""
    import webbrowser

    print(f"{command}: {url} (Ctrl+C ends)", flush=True)
    webbrowser.open(url)


def _save(runs: Mapping[str, Run], path: Path, in_progress: object) -> None:
    """Write a page that plays saved runs."""
    from dqcontrol.browser.replay import replay_of_runs
    from dqcontrol.errors import ExistsError, ValueRangeError, writing

    if in_progress:
        raise ValueRangeError("save: takes runs that are over; one in progress is shown without it")
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
    chosen = convert(path, about["robot"], RobotSpec)
    robot = chosen.load()
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
