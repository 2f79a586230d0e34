"""Recordings that grow, and runs in real time."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.browser import GrowingRecording, LiveRun, Page, Track, growing_recording
from dqcontrol.browser.served_page import HOST, import_viser
from dqcontrol.cli import main
from dqcontrol.errors import FileFormatError, MissingExtraError, ShapeError
from dqcontrol.recording import RecordStream, load_metadata, load_record

SPEC = {
    "name": "live",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 0.6},
    "law": {"kind": "proportional-feedforward", "gain": 5},
    "plant": {"kind": "servo"},
}


def until(condition, seconds=240.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.02)


def test_a_recording_is_read_while_it_grows(tmp_path):
    arm = dqc.load_robot("iiwa7")
    path = tmp_path / "record.mcap"
    stream = RecordStream(path, arm, "robot: iiwa7")
    growing = GrowingRecording(path, arm)
    sample = np.zeros(21)

    def write(first, count):
        for k in range(first, first + count):
            q = np.full(7, 0.001 * k)
            sample[:8], sample[-1] = arm.fkm(q), 0.01 * k
            stream.take(sample, q, q, 2 * q)

    write(0, 200)
    until(lambda: (record := growing.record()) is not None and len(record) > 50)
    before = growing.first()
    assert before.stopped == ""
    write(200, 100)
    until(lambda: len(growing.first()) > len(before))
    stream.close("the end")
    path = path.rename(tmp_path / "elsewhere.mcap")  # as folders of results do
    until(lambda: not growing.goes_on)
    record, saved = growing.first(), load_record(path)
    assert record.stopped == "the end"
    for name in ("time", "q", "measured", "command", "pose", "desired"):
        assert (getattr(record, name) == getattr(saved, name)).all(), name


def test_the_folder_of_a_run_is_followed_until_it_has_results(tmp_path):
    assert growing_recording(tmp_path) is None
    recording = tmp_path / "record.mcap"
    assert growing_recording(recording) == recording
    recording.touch()
    assert growing_recording(tmp_path) == recording
    (tmp_path / "metrics.json").touch()
    assert growing_recording(tmp_path) is None


def test_a_run_that_was_broken_off_is_over(tmp_path):
    recording = tmp_path / "record.mcap"
    stream, told = RecordStream(recording, dqc.load_robot("iiwa7")), KeyboardInterrupt()
    assert growing_recording(tmp_path) == recording
    stream.__exit__(type(told), told, None)
    assert told.__notes__ == [f"recorded until then: {recording}"]
    assert load_metadata(recording)["stopped"] == "broken off: KeyboardInterrupt"
    assert growing_recording(tmp_path) is None


def test_a_recording_without_samples_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("dqcontrol.browser.live._PATIENCE", 0.1)
    arm = dqc.load_robot("iiwa7")
    with RecordStream(tmp_path / "record.mcap", arm):
        growing = GrowingRecording(tmp_path / "record.mcap", arm)
        with pytest.raises(FileFormatError, match=r"no samples were recorded in 0\.1 s"):
            growing.first()
        growing.close()
        until(lambda: not growing.goes_on)


def test_a_spec_runs_in_real_time(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    running = LiveRun(SPEC)
    growing = GrowingRecording(running.path, running.robot)
    growing.first()
    until(lambda: not growing.goes_on)
    record = growing.first()
    assert (running.failure, record.stopped) == (None, "duration")
    assert len(record) == 61
    expected = dqc.run(SPEC).record
    assert (record.q == expected.q).all()  # the same run, only slower
    assert running.planned == pytest.approx(expected.desired_position)
    running.close()
    assert not running.path.exists()
    assert not list(tmp_path.iterdir())


def test_several_runs_cannot_be_live():
    laws = {"a": SPEC["law"], "b": SPEC["law"]}
    spec = {key: value for key, value in SPEC.items() if key != "law"} | {"laws": laws}
    with pytest.raises(ShapeError, match="describes several runs"):
        LiveRun(spec)


def fails(monkeypatch, capsys, *words):
    monkeypatch.setattr("sys.argv", ["dqcontrol", "view", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    return message


def test_mistakes_give_one_line(tmp_path, monkeypatch, capsys):
    pytest.importorskip("viser")
    assert "at least one folder" in fails(monkeypatch, capsys)
    assert "is not the folder of a run" in fails(monkeypatch, capsys, tmp_path)
    assert "port" in fails(monkeypatch, capsys, tmp_path, "--port", "80").lower()
    assert "no such file" in fails(monkeypatch, capsys, tmp_path / "none.mcap")
    with RecordStream(tmp_path / "record.mcap", dqc.load_robot("iiwa7")):
        pass
    assert "does not name its robot" in fails(monkeypatch, capsys, tmp_path / "record.mcap")


def test_without_viser_one_line_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(MissingExtraError):
        import_viser()
    assert "pip install 'dqcontrol[view]'" in fails(monkeypatch, capsys, tmp_path)


def test_the_page_is_for_this_machine_only(monkeypatch):
    asked = {}
    fake = SimpleNamespace(ViserServer=lambda **options: asked.update(options) or 1 / 0)
    monkeypatch.setattr("dqcontrol.browser.served_page.import_viser", lambda: fake)
    with pytest.raises(ZeroDivisionError):
        Page([], 8080)
    assert asked["host"] == HOST == "127.0.0.1"


def test_what_the_page_opens_is_on_the_loopback(tmp_path):
    pytest.importorskip("viser")
    psutil = pytest.importorskip("psutil")
    arm = dqc.load_robot("iiwa7")
    with RecordStream(tmp_path / "record.mcap", arm) as stream:
        sample = np.concatenate([arm.fkm(np.zeros(7)), np.zeros(13)])
        stream.take(sample, np.zeros(7), np.zeros(7), np.zeros(7))
    page = Page([Track("one", arm, load_record(tmp_path / "record.mcap"))], 18085)
    try:
        opened = psutil.Process().net_connections("inet")
        listening = {socket.laddr.ip for socket in opened if socket.status == psutil.CONN_LISTEN}
        assert listening == {"127.0.0.1"}
    finally:
        page.server.stop()
