"""Learn a motion from repetition."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import print_table, progress_bar

if TYPE_CHECKING:
    from dqcontrol.tuning import Learning


def learn(
    spec: Path,
    /,
    *ros_arguments: Annotated[
        str, Parameter(allow_leading_hyphen=True, help="After --: as after --ros-args.")
    ],
    repeats: int | None = None,
    out: Out = None,
    force: Force = False,
    real_time: bool = False,
    ros2: Literal["velocity", "position", "trajectory"] | None = None,
    network: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Repeat a motion and learn from each repeat; writes learnt.csv, and learnt.yaml, which dqcontrol run runs.

    Parameters
    ----------
    spec
        YAML file of one run, perhaps with the key learn; see docs/learn.md.
    repeats
        Most repeats after the first run.
    out
        New folder for the results; default: results/NAME-learnt, NAME from the spec.
    force
        Replace an earlier folder of results.
    real_time
        Each run on the clock.
    ros2
        Repeat on the robot behind ROS 2 topics, with such commands; see docs/learn.md.
    network
        With --ros2: do not keep to the loopback.
    """
    from dqcontrol.errors import ValueRangeError
    from dqcontrol.tuning import learn_to
    from dqcontrol.tuning.learning.learn_spec import read_learn

    folder = out or Path("results") / f"{read_learn(spec).spec.name}-learnt"
    runner = None
    if ros2 is not None:
        from dqcontrol.ros2 import middleware

        middleware.check_installed()
        from dqcontrol.ros2.repeated_motion import RobotBehindTopics

        repeated = folder.with_name(f"{folder.name}-repeats")
        runner = RobotBehindTopics(repeated, ros2, network=network, ros_arguments=ros_arguments)
    elif network or ros_arguments:
        what = "--network" if network else ros_arguments[0]
        raise ValueRangeError(
            f"{what}: is for a robot behind topics; give --ros2 velocity, too, or leave it out"
        )
    with progress_bar() as progress:
        learn_to(
            spec,
            folder,
            repeats,
            force=force,
            real_time=real_time,
            runner=runner,
            progress=lambda done, total: progress(done, total, "repeats"),
            computed=lambda found: _show(found, folder),
        )


def _show(found: Learning, folder: Path) -> None:
    """Print what was learnt, before its figure is drawn."""
    print(f"results: {folder}")
    print_table(found.table())
    for remark in found.remarks():
        print(remark)
    sys.stdout.flush()
