"""Runs as one page that opens without us: scene, robots and their motion, with numbers beside each robot."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence

import numpy as np

from dqcontrol.browser.page import Page
from dqcontrol.browser.run_view_model import Reading, Track, extent
from dqcontrol.browser.served_page import stop_server
from dqcontrol.experiments.run import Run

_RATE = 25.0  # pictures a second, as films have
_MOST = 1000  # pictures: a robot of ten frames then takes about half a megabyte
_NUMBERS_EVERY = 0.25  # s: browsers take some time to make letters, and would never come to it
_AHEAD, _ABOVE = 0.2, 0.02  # of the scene's size: numbers stand before the robot's foot
_PORT = 18700  # of the server that the scene is taken from; the next free one if it is taken


def replay_page(tracks: Sequence[Track], title: str) -> str:
    """Return a page of HTML that plays runs, side by side; it has slider and speed, and needs no network.

    Parameters
    ----------
    tracks
        At least one run.
    title
        Of the page.

    Raises
    ------
    MissingExtraError
        If viser is not installed.

    Examples
    --------
    >>> page = replay_page([Track("mine", run.robot, run.record)], "mine")  # doctest: +SKIP
    >>> pathlib.Path("mine.html").write_text(page)  # doctest: +SKIP
    """
    page = Page(tracks, _PORT)
    try:
        server = page.server
        if len(tracks) > 1:
            page.show_beside()
        box = extent(tracks)
        position, looked_at = page.viewpoint
        ahead = (position - looked_at) * [1.0, 1.0, 0.0]
        at = _AHEAD * box.size * ahead / np.linalg.norm(ahead)  # floors would hide what is below them
        at[2] = box.lower[2] + _ABOVE * box.size
        labels = [
            server.scene.add_label(f"/run{i}/numbers", _numbers(track, 0), position=at, anchor="top-center")
            for i, track in enumerate(tracks)
        ]
        end = max(float(track.record.time[-1]) for track in tracks)
        count = int(min(max(round(_RATE * end), 1), _MOST))
        step = end / count
        every = max(round(_NUMBERS_EVERY / step), 1)
        page.show_at(0.0)
        serializer = server.get_scene_serializer()
        for k in range(1, count + 1):
            serializer.insert_sleep(step)
            page.show_at(k * step)
            if k % every and k < count:
                continue
            for label, track in zip(labels, tracks, strict=True):
                text = _numbers(track, track.index(k * step))
                if text != label.text:
                    label.text = text
        made: str = serializer.as_html()
    finally:
        stop_server(page.server)
    head = f"<title>{html.escape(title)}</title>"
    return made.replace("<head>", f"<head>{head}", 1)


def replay_of_runs(runs: Mapping[str, Run]) -> str:
    """Return the same of runs by their labels, as `load_runs` gives them."""
    return replay_page([Track.of_run(label, run) for label, run in runs.items()], " · ".join(runs))


def _numbers(track: Track, k: int) -> str:
    """Return what is said of a sample, in lines."""
    reading: Reading = track.reading(k)
    lines = [track.label, f"t = {reading.time:.2f} s", f"error {1e3 * reading.position_error:.2f} mm"]
    if np.isfinite(reading.speed):
        lines.append(f"speed {100 * reading.speed:.0f} % of limit")
    if reading.nearest is not None:
        lines.append(f"{reading.nearest.label}: {1e3 * reading.nearest.room:.0f} mm to spare")
    if reading.plan:
        lines.append(reading.plan)
    return "\n".join(lines)
