"""What lies in the reader's folder before a page is done: the examples, and what stands for the reader's own files."""

from pathlib import Path

import numpy as np
import yaml
from log_files import CIRCLE, EPOCH, joint_state, numbers, pose_stamped, write_bag, write_mcap
from page_blocks import ROOT, blocks
from servo_simulator import answer, encoder, multisine, write_log
from tracker_simulator import measured, spoiled, write_poses

import dqcontrol as dqc
from dqcontrol.experiments.results_folder import folder_names
from dqcontrol.files.yaml_file import parse_yaml


def prepare(page: str, folder: Path) -> None:
    """Put all files there that the page takes for granted."""
    (folder / "examples").mkdir()
    for path in (ROOT / "examples").iterdir():
        (folder / "examples" / path.name).symlink_to(path)
    for block in blocks(page):
        if block.name:
            (folder / block.name).write_text(block.text, encoding="utf-8")
    _OWN_FILES.get(page, lambda _: None)(folder)


def _demo(folder: Path) -> None:
    """Results of the demo, of its first second."""
    spec = parse_yaml("demo", (ROOT / "examples/demo.yaml").read_text(encoding="utf-8"))
    spec |= {"duration": 1.0, "skip_initial": 0}
    (folder / "examples" / "short.yaml").write_text(yaml.safe_dump(spec), encoding="utf-8")
    runs = dqc.run_study(folder / "examples" / "short.yaml").runs
    for label, name in folder_names(runs).items():
        _save(runs[label], folder / "results" / "demo" / name)


def _save(run: dqc.Run, folder: Path) -> None:
    """Write a run without plots and report, which take long."""
    folder.mkdir(parents=True)
    run.write_data(folder)


def _short_sweep(folder: Path) -> None:
    """The example with 16 points instead of 512."""
    path = folder / "examples" / "sweep.yaml"
    text = path.read_text(encoding="utf-8")
    assert "points: 512" in text
    path.unlink()
    path.write_text(text.replace("points: 512", "points: 16"), encoding="utf-8")


def _room(folder: Path) -> None:
    """The map of a room, far from where the page's robot is."""
    corners = [[8.0, 8.0], [9.0, 8.0], [9.0, 9.0]]
    (folder / "examples" / "room.yaml").write_text(yaml.safe_dump({"polygons": [corners]}), encoding="utf-8")


def _circle_and_demo(folder: Path) -> None:
    _demo(folder)
    _save(dqc.run(CIRCLE), folder / "results" / "circle")


def _logs(folder: Path) -> None:
    """One run as a user's recordings would hold it."""
    run = dqc.run(CIRCLE)
    _save(run, folder / "results" / "circle")
    names, messages = list(run.record.joint_names), []
    for k, time in enumerate(run.time):
        stamp = EPOCH + round(time * 1e9)
        position = run.record.desired_position[k]
        messages.append(("/joint_states", stamp, joint_state(stamp, names, run.q[k])))
        messages.append(("/velocity_controller/commands", stamp, numbers(run.command[k])))
        messages.append(("/target", stamp, pose_stamped(stamp, position, run.desired[k, :4])))
    write_bag(folder / "bag", messages)
    write_mcap(folder / "log.mcap", messages)
    taught = np.column_stack([run.time, run.q])
    header = "time," + ",".join(f"q{i + 1}" for i in range(7))
    np.savetxt(folder / "taught.csv", taught, delimiter=",", header=header, comments="")


def _servo_log(folder: Path) -> None:
    """Six joints of an arm on multisines, as its driver would log them."""
    rng = np.random.default_rng(1)
    time = np.arange(1500) * 0.008
    targets = np.column_stack([multisine(rng, time) for _ in range(6)])
    seen = np.column_stack(
        [answer(time, target, 0.03 + 0.01 * i, 0.01 + 0.003 * i, time) for i, target in enumerate(targets.T)]
    )
    write_log(folder / "arm.csv", time, targets, encoder(rng, seen, 0.0, 1e-4))


def _servo_log_and_results(folder: Path) -> None:
    _servo_log(folder)
    (folder / "examples" / "results").symlink_to(folder / "results")  # specs of pages are read in examples


def _measured_poses(folder: Path) -> None:
    """Fifty poses of a UR5 that a tracker measured."""
    rng = np.random.default_rng(1)
    write_poses(folder / "poses.csv", *measured(rng, spoiled(rng, dqc.load_robot("ur5")), 50))
    (folder / "examples" / "results").symlink_to(folder / "results")  # specs of pages are read in examples


_OWN_FILES = {
    "real-time.md": _room,
    "reports.md": _circle_and_demo,
    "sweeps.md": _short_sweep,
    "own-data.md": _logs,
    "calibrate.md": _measured_poses,
    "identify.md": _servo_log_and_results,
}
