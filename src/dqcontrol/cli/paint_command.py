"""Paint a drawing with light."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from dqcontrol.cli.options import METRES, SPEED, BaseLink, Out, ReplaceResults, TipLink, numbers


def paint(
    drawing: Path,
    /,
    *,
    out: Out = None,
    force: ReplaceResults = False,
    robot: str = "panda",
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    start: str | None = None,
    drawing_width: Annotated[float | None, METRES] = None,
    speed: Annotated[float, SPEED] = 0.1,
    plane: Literal["xy", "xz", "yz"] = "xz",
    law: str | None = None,
    plant: str | None = None,
) -> None:
    """Paint a drawing with a lamp in the hand: a picture as a long exposure shows it, a clip and the recording.

    Parameters
    ----------
    drawing
        SVG file, or a drawing file (.txt).
    out
        New folder for the results; default: results/NAME, NAME from the file.
    robot
        Name, .yaml, .urdf or .xacro file, or example-robot-data:PATH; other robots than panda need --start.
    start
        Configuration with the hand in the middle of the paper, as 0,0.6,0 (rad or m) or 0,35deg,0.
    drawing_width
        Metres; default: as wide as the arm reaches, up to 0.45 m.
    speed
        Of the lamp, m/s.
    plane
        How the paper lies.
    law
        As in a spec, "{kind: proportional, gain: 5}", or a kind of dqcontrol list laws; default: lqr-dq with q/r = 100.
    plant
        As in a spec, or a kind of dqcontrol list plants; default: servo.
    """
    import yaml

    from dqcontrol.experiments.painting import paint as painted
    from dqcontrol.experiments.results_folder import check_new, new_folder
    from dqcontrol.experiments.spec.spec import part_of_spec
    from dqcontrol.films.light_painting import light_painting, painting_clip
    from dqcontrol.measures import evaluate
    from dqcontrol.recording import save_record
    from dqcontrol.robots import load_robot

    folder = out or Path("results") / drawing.stem
    check_new(folder, force=force)
    q = numbers("start", start, "rad or m")
    source = str(Path(robot).resolve()) if Path(robot).is_file() else robot  # for `dqcontrol view`
    ends = {"base_link": base_link, "tip_link": tip_link}
    chain = {key: link for key, link in ends.items() if link is not None}
    arm = load_robot(robot, **ends) if chain else robot
    chosen = {
        name: part_of_spec(f"--{name}", text, name)
        for name, text in (("law", law), ("plant", plant))
        if text is not None
    }
    done = painted(drawing, arm, q, width=drawing_width, speed=speed, plane=plane, **chosen)
    with new_folder(folder, force=force) as new:
        light_painting(done.record, done.lit).savefig(new / "painting.png", dpi=150)
        painting_clip(done.record, new / "painting.gif", done.lit)
        save_record(
            done.record,
            new / "record.mcap",
            yaml.safe_dump({"robot": {"source": source, **chain} if chain else source}),
        )
    print(f"results: {folder}")
    across, up = (1e3 * side for side in done.size)
    print(f"{done.robot.name}: {across:.0f} × {up:.0f} mm in {done.record.duration:.0f} s")
    print(f"RMS error of the hand: {evaluate(done.record).position.rms:.2f} mm")
