"""Draw the picture of docs/mobile-bases.md: `python tools/update_mobile_bases.py`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.experiments import Run, run_study
from dqcontrol.figures.style import DOUBLE, line_style, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROOT = Path(__file__).parents[1]


@styled
def lost_camera(runs: dict[str, Run]) -> Figure:
    """Plot the speed of the base, that of the arm's fastest joint, and the age of the last frame."""
    figure = new_figure(DOUBLE, 4.6)
    speed, joints, age = figure.subplots(3, 1, sharex=True)
    for i, (label, run) in enumerate(runs.items()):
        record = run.record
        rates = np.diff(record.q, axis=0) / np.diff(record.time)[:, None]
        speed.plot(
            record.time[:-1], np.hypot(*rates[:, :2].T), label=label.rpartition(" · ")[2], **line_style(i)
        )
        joints.plot(record.time[:-1], np.abs(rates[:, 3:]).max(axis=1), **line_style(i))
        age.plot(record.time, record.readings["camera_age"].values[:, 0], **line_style(i))
    for axes in (speed, joints, age):
        axes.axvspan(4, 10, color="#dddddd", lw=0, zorder=0)
        axes.set_xlim(0, 25)
    speed.set_ylabel("base [m/s]")
    speed.legend()
    joints.set_ylabel("arm [rad/s]")
    age.set_ylabel("last frame [s ago]")
    age.set_xlabel("time [s]")
    figure.align_ylabels()
    return figure


if __name__ == "__main__":
    study = run_study(ROOT / "examples/lost-camera.yaml", jobs=1)
    lost_camera(dict(study.runs)).savefig(ROOT / "docs/pictures/lost-camera.png")
