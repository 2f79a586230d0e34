"""Learn a motion from repetition."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import print_table, progress_bar


def learn(
    spec: Path,
    /,
    *,
    repeats: int | None = None,
    out: Out = None,
    force: Force = False,
    real_time: bool = False,
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
    """
    from dqcontrol.tuning import learn_to
    from dqcontrol.tuning.learning.learn_spec import read_learn

    folder = out or Path("results") / f"{read_learn(spec).spec.name}-learnt"
    with progress_bar() as progress:
        found = learn_to(
            spec,
            folder,
            repeats,
            force=force,
            real_time=real_time,
            progress=lambda done, total: progress(done, total, "repeats"),
        )
    print_table(found.table())
    for remark in found.remarks():
        print(remark)
    print(f"results: {folder}")
