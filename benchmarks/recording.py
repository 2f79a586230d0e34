"""Recording of runs: its time beside the loop's and that of MCAP's own writer, the size of the file, and the memory.

    python benchmarks/recording.py [--steps 1000000]

Times are those of the processor: what else the machine does, and its disk, is not in them.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from measure import Ratio, table

import dqcontrol as dqc
from dqcontrol.recording import load_record, save_record

START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
PERIOD = 0.01
SAMPLES = 10_000  # that MCAP's own writer writes


def noisy(steps: int) -> dqc.Record:
    """Return a run on servos with noisy encoders: no sample is like another."""
    arm = dqc.load_robot("iiwa7")
    circle = dqc.references.Circle(arm.fkm(START), radius=0.05, duration=10.0, turns=-(-steps // 1000))
    law, servo = dqc.laws.Proportional(gain=10.0), dqc.plants.Servo(encoder_noise=1e-4)
    return dqc.simulate(arm, circle, law, servo, START, PERIOD, steps * PERIOD)


def seconds(function: Callable[[], object]) -> float:
    """Return the time that a call takes of the processor, s."""
    begin = time.process_time()
    function()
    return time.process_time() - begin


def by_library(path: Path, target: Path) -> Callable[[], None]:
    """Return what writes the messages of a recording one by one with MCAP's own writer."""
    with open(path, "rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        messages = [vars(each) for _, _, each in reader.iter_messages(log_time_order=False)]
    assert summary

    def write() -> None:
        with open(target, "wb") as stream:
            writer = Writer(stream)
            writer.start("ros2")
            for schema in summary.schemas.values():
                writer.register_schema(schema.name, schema.encoding, schema.data)
            for channel in summary.channels.values():
                writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id)
            for message in messages:
                writer.add_message(**message)
            writer.finish()

    return write


def ratios(short: bool) -> list[Ratio]:
    """Return the time of a step's recording against the loop's and the library's."""
    record = noisy(SAMPLES)
    rounds = 1 if short else 5
    ours, theirs, loop = [], [], []
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "ours.mcap"
        save_record(record, path)
        write = by_library(path, Path(name) / "theirs.mcap")
        for _ in range(rounds):
            loop.append(seconds(lambda: noisy(SAMPLES)))
            path.unlink()
            ours.append(seconds(lambda: save_record(record, path)))
            theirs.append(seconds(write))
        if load_record(path).q.tobytes() != record.q.tobytes():
            raise SystemExit("what is read is not what was recorded")
        larger = path.stat().st_size / (Path(name) / "theirs.mcap").stat().st_size
    a, b, c = (1e6 * min(each) / SAMPLES for each in (ours, theirs, loop))
    return [
        Ratio("recording of a sample", a, "µs", "", 1.0, "≤ 2"),
        Ratio("recording of a sample", a, "µs", "MCAP's own writer", b, "≤ 0.04"),
        Ratio("recording of a sample", a, "µs", "the run itself", c, "≤ 3"),
        Ratio("size of the file", larger, "times", "MCAP's own writer", 1.0, "≤ 1.1"),
    ]


def growth(most: int) -> None:
    """Print time, size and memory for runs of a thousand to so many steps."""
    largest, over = [0.0, 0.0], threading.Event()

    def watch() -> None:
        while not over.wait(0.02):
            largest[:] = map(max, largest, _memory())

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        steps = 1000
        while steps <= most:
            record = noisy(steps)
            with tempfile.TemporaryDirectory() as name:
                path = Path(name) / "record.mcap"
                whole = seconds(lambda record=record, path=path: save_record(record, path))
                print(
                    f"{steps:>9,} steps: {whole:.3f} s of the processor, {1e6 * whole / steps:.2f} µs a step, "
                    f"{path.stat().st_size / 2**20:.1f} MiB; so far at most {largest[0]:.0f} MiB of its own, "
                    f"{largest[1]:.0f} MiB with mapped files"
                )
            steps *= 10
    finally:
        over.set()
        thread.join()


def _memory() -> tuple[float, float]:
    """Return the memory of this process, MiB: what is its own, and all that is resident."""
    lines = dict(
        line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines() if ":" in line
    )
    own, resident = (int(lines[key].split()[0]) / 1024 for key in ("RssAnon", "VmRSS"))
    return own, resident


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--steps", type=int, default=1_000_000, help="of the longest run")
    chosen = options.parse_args()
    print(table(ratios(short=False), "Recording").markdown())
    growth(chosen.steps)


if __name__ == "__main__":
    main()
