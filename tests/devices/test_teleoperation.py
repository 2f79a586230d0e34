"""Devices drive a robot: clutch without a jump, rest when they fall silent. No device is plugged in here: what they
tell is written by hand, event by event, in the shape in which pygame-ce 2.5, pyspacemouse 2.1 and WebXR have it."""

import json
import sys
import urllib.request
from types import SimpleNamespace

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.devices import Gamepad, LeaderArm, SpaceMouse, Teleoperation, Told, WebXr
from dqcontrol.devices.web_xr import told_by
from dqcontrol.errors import Error, MissingExtraError
from dqcontrol.loop import Live

T, Q0 = 0.01, np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])


@pytest.fixture
def live():
    guard = dqc.supervisor.Supervisor(acceleration=8.0)
    law = dqc.laws.Proportional(gain=5.0)
    return Live(dqc.load_robot("iiwa7"), law, dqc.plants.Integrator(), T, start=Q0, supervisor=guard)


def place(live):
    return algebra.translation(live.state.pose)


def drive(live, driven, tell, count, begin=0.0):
    for k in range(count):
        now = begin + k * T
        driven.take(tell(now), now)
        live.step()
    return begin + count * T


def test_a_tracked_device_moves_the_hand_from_where_both_are(live):
    driven, start = Teleoperation(live, scale=0.5), place(live)
    turn = algebra.rotation_from_axis_angle([0, 0, 1], 0.8)

    def device(shift):
        return algebra.pose(turn, np.array([3.0, -2.0, 1.0]) + shift)

    now = drive(live, driven, lambda t: Told(t, True, pose=device(np.zeros(3))), 50)
    assert np.abs(place(live) - start).max() < 1e-6  # taking the clutch moves nothing
    now = drive(live, driven, lambda t: Told(t, True, pose=device(np.array([0, 0, 0.1]))), 400, now)
    moved = place(live) - start
    np.testing.assert_allclose(moved, [0, 0, 0.05], atol=5e-4)  # in the room, however the device is turned
    there = place(live)
    now = drive(live, driven, lambda t: Told(t, False, pose=device(np.full(3, 5.0))), 100, now)
    assert not driven.is_engaged
    assert np.abs(place(live) - there).max() < 1e-3
    there = place(live)
    drive(live, driven, lambda t: Told(t, True, pose=device(np.full(3, 5.0))), 100, now)  # taken elsewhere
    assert np.abs(place(live) - there).max() < 1e-4


@pytest.mark.parametrize(
    "fault",
    [
        lambda t: None,
        lambda t: Told(t - 1.0, True, linear=np.array([1.0, 0, 0])),
        lambda t: Told(np.nan, True, linear=np.array([1.0, 0, 0])),
        lambda t: Told(t, True, linear=np.array([np.nan, 0, 0])),
        lambda t: Told(t, True, pose=np.zeros(8)),
        lambda t: Told(t, True, pose=np.full(8, np.inf)),
        lambda t: Told(t, False, linear=np.array([1.0, 0, 0])),
    ],
    ids=["silent", "old", "no stamp", "no number", "no pose", "infinite", "let go"],
)
def test_what_is_silent_old_or_no_number_lets_the_hand_rest(live, fault):
    driven = Teleoperation(live)
    now = drive(live, driven, lambda t: Told(t, True, linear=np.array([0, 1.0, 0])), 60)
    assert live.control.command.any()
    now = drive(live, driven, fault, 150, now)
    assert not driven.is_engaged
    before = place(live)
    drive(live, driven, fault, 60, now)
    assert np.abs(place(live) - before).max() < 1e-3


class WrittenPad:
    """A gamepad of SDL that tells events written by hand: axes of 16 bits, and buttons."""

    def __init__(self, events):
        self.events, self.k = events, 0

    def attached(self):
        return self.k < len(self.events)

    def get_axis(self, i):
        return self.events[self.k][0].get(i, 0)

    def get_button(self, i):
        return i in self.events[self.k][1]

    def quit(self):
        self.k = len(self.events)


def written_gamepad(monkeypatch, events):
    pad = WrittenPad(events)
    controllers = SimpleNamespace(
        init=lambda: None,
        get_count=lambda: 1,
        is_controller=lambda _: True,
        Controller=lambda _: pad,
    )
    pygame = SimpleNamespace(
        display=SimpleNamespace(init=lambda: None), event=SimpleNamespace(pump=lambda: None)
    )
    monkeypatch.setitem(sys.modules, "pygame", pygame)
    monkeypatch.setitem(sys.modules, "pygame._sdl2.controller", controllers)
    return pad, controllers


def test_a_gamepad_moves_while_its_shoulder_button_is_held(monkeypatch):
    pad, controllers = written_gamepad(
        monkeypatch,
        [
            ({0: 900, 1: -1200}, ()),  # sticks that are worn
            ({1: -32768}, (9,)),
            ({0: 16384, 3: -32767}, (9, 0)),
            ({0: 16384, 1: -16384}, (9, 10)),
        ],
    )
    device = Gamepad()
    told = device.read()
    assert not told.clutch
    assert not told.linear.any()
    pad.k = 1
    told = device.read()
    assert told.clutch
    np.testing.assert_array_equal(told.linear, [1, 0, 0])  # forward, and no more than full
    pad.k = 2
    told = device.read()
    np.testing.assert_allclose(told.linear, [0, -0.5, 1], atol=1e-4)
    assert told.gripper == 1.0
    pad.k = 3
    told = device.read()
    assert not told.linear.any()
    np.testing.assert_allclose(told.angular, [0.5, 0.5, 0], atol=1e-4)
    assert told.gripper == 1.0  # stays closed
    device.close()
    assert device.read() is None  # unplugged
    controllers.get_count = lambda: 0
    with pytest.raises(Error, match="gamepad: none is plugged in"):
        Gamepad()


def test_a_space_mouse_is_pushed_in_six_directions(monkeypatch):
    states = [
        SimpleNamespace(t=-1.0, x=0.02, y=0, z=0, roll=0, pitch=0, yaw=-0.01, buttons=[0, 0]),
        SimpleNamespace(t=0.1, x=0.5, y=-0.25, z=1.0, roll=0, pitch=0.1, yaw=0, buttons=[1, 0]),
        SimpleNamespace(t=0.2, x=0, y=0, z=0, roll=0, pitch=0, yaw=0.4, buttons=[0, 1]),
        None,
    ]
    opened = {}

    def open_device(**options):
        opened.update(options)
        return SimpleNamespace(read=lambda: states.pop(0), close=lambda: None)

    library = SimpleNamespace(open=open_device, AxisConvention=SimpleNamespace(ROS="ros"))
    monkeypatch.setitem(sys.modules, "pyspacemouse", library)
    knob = SpaceMouse()
    assert opened == {"axis_convention": "ros"}
    assert not knob.read().clutch
    told = knob.read()
    np.testing.assert_array_equal(told.linear, [0.5, -0.25, 1.0])
    np.testing.assert_array_equal(told.angular, [0, 0.1, 0])
    assert (told.clutch, told.gripper) == (True, 1.0)
    assert knob.read().gripper == 0.0
    assert knob.read() is None

    def refuse(**options):
        raise RuntimeError("No connected or supported devices found.")

    library.open = refuse
    with pytest.raises(Error, match="space mouse: cannot be read: No connected"):
        SpaceMouse()


@pytest.mark.parametrize(("module", "kind"), [("pygame", Gamepad), ("pyspacemouse", SpaceMouse)])
def test_without_its_library_one_line_says_what_to_install(monkeypatch, module, kind):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dqcontrol\[devices\]'"):
        kind()


def sent(address, messages):
    from websockets.sync.client import connect

    with connect(address, origin=address.replace("ws:", "http:").removesuffix("/told")) as socket:
        for message in messages:
            socket.send(message)
            yield


def xr(position, quaternion=(1, 0, 0, 0), *, clutch=True, gripper=None):
    return json.dumps({"position": position, "quaternion": quaternion, "clutch": clutch, "gripper": gripper})


def until(condition):
    while not condition():
        pass


def test_a_phone_moves_the_hand_by_its_page(live):
    """A phone goes 10 cm up and 5 cm ahead of where it is when a finger touches it: y up and −z ahead in WebXR."""
    pytest.importorskip("websockets")
    device, start = WebXr(0), place(live)
    try:
        assert "navigator.xr" in urllib.request.urlopen(device.url).read().decode()
        driven, now = Teleoperation(live), 0.0
        script = [
            xr([0.3, 1.2, 0.1], clutch=False),
            xr([0.3, 1.2, 0.1]),
            xr([0.3, 1.3, 0.05], gripper=0.7),
            xr([0.3, 9.0, 0.05], clutch=False),
        ]
        before = device.read()
        moves = sent(f"ws://localhost:{device.port}/told", script)
        for message in script:
            next(moves)
            until(lambda: device.read() is not before)  # noqa: B023
            before = device.read()
            assert before.clutch == json.loads(message)["clutch"]
            now = drive(live, driven, lambda t: device.read()._replace(stamp=t), 200, now)
            if message == script[1]:
                assert np.abs(place(live) - start).max() < 1e-6
            if message == script[2]:
                assert device.read().gripper == 0.7
                np.testing.assert_allclose(place(live) - start, [0.05, 0, 0.1], atol=1e-3)
        np.testing.assert_allclose(place(live) - start, [0.05, 0, 0.1], atol=2e-3)
        moves.close()
        until(lambda: device.read() is None)  # the page has gone
    finally:
        device.close()


@pytest.mark.parametrize(
    "message",
    [
        "",
        "{}",
        "[1, 2]",
        b"\xff\xfe",
        xr([0, 0]),
        xr([0, 0, 0], [1, 0, 0]),
        xr([0, 0, 0], [0, 0, 0, 0]),
        '{"position": [NaN, 0, 0], "quaternion": [1, 0, 0, 0], "clutch": true}',
        '{"position": [1e999, 0, 0], "quaternion": [1, 0, 0, 0], "clutch": true}',
        '{"position": ["a", 0, 0], "quaternion": [1, 0, 0, 0], "clutch": true}',
    ],
)
def test_a_page_that_says_no_pose_says_nothing(message):
    assert told_by(message, 0.0) is None


def test_turns_of_a_phone_are_about_our_axes():
    """A turn about WebXR's y axis, up, is one about our z axis."""
    half = np.sqrt(0.5)
    told = told_by(xr([0, 0, 0], [half, 0, half, 0]), 0.0)
    np.testing.assert_allclose(told.pose[:4], [half, 0, 0, half], atol=1e-12)


def test_pages_of_others_may_not_drive():
    websockets = pytest.importorskip("websockets")
    from websockets.sync.client import connect

    device = WebXr(0)
    try:
        with pytest.raises(websockets.exceptions.InvalidStatus, match="403"):
            connect(f"ws://localhost:{device.port}/told", origin="http://elsewhere.org")
        with pytest.raises(Error, match="cannot be had"):
            WebXr(device.port)
    finally:
        device.close()


def test_a_leader_arm_of_five_joints_leads_another_arm(live):
    leader, start = dqc.load_robot("youbot-arm"), place(live)
    angles = np.array([0.1, -0.5, 0.6, 0.3, 0.0])
    said = {"joints": angles}
    device = LeaderArm(leader, lambda: said["joints"], gripper=lambda: 0.3)
    driven = Teleoperation(live, scale=2.0)
    now = drive(live, driven, lambda t: device.read()._replace(stamp=t), 50)
    assert np.abs(place(live) - start).max() < 1e-6
    assert device.read().gripper == 0.3
    moved = angles + np.array([0.1, 0.05, 0, 0, 0])
    said["joints"] = moved
    now = drive(live, driven, lambda t: device.read()._replace(stamp=t), 300, now)
    led = algebra.translation(leader.fkm(moved)) - algebra.translation(leader.fkm(angles))
    np.testing.assert_allclose(place(live) - start, 2.0 * led, atol=1e-3)
    for nothing in (None, np.full(5, np.nan), np.zeros(4), ["a"] * 5):
        said["joints"] = nothing
        assert device.read() is None
