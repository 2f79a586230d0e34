"""Dual quaternion control laws for arms: compiled simulation, physics, experiments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

from dqcontrol.experiments import result_pages as _result_pages
from dqcontrol.version import __version__ as __version__

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from dqcontrol.constraints import Constraints
    from dqcontrol.experiments.run import Run
    from dqcontrol.loop import Record
    from dqcontrol.plants.plant import Plant
    from dqcontrol.robots import Robot

# As in all packages: what is offered stands in `__init__.pyi`, and is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def _report_pages() -> _result_pages.ResultPages:
    from dqcontrol.reports import study_reports

    return study_reports


def _replay(runs: Mapping[str, Run]) -> str:
    from dqcontrol.browser.replay import replay_of_runs

    return replay_of_runs(runs)


def _clip(robot: Robot, plant: Plant, record: Record, path: Path, kept: Constraints | None) -> None:
    from dqcontrol.films import render_clip

    render_clip(robot, plant, record, path, kept=kept)


_result_pages.hand_in(_result_pages.HandedIn(_report_pages, _replay, _clip))
