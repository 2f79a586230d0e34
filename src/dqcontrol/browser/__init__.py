"""Runs in a browser: `Track` is what there is to see of one, `Page` shows them; `RobotPage` shows a robot alone."""

from dqcontrol.browser.live import GrowingRecording, LiveRun, growing_recording
from dqcontrol.browser.page import Page
from dqcontrol.browser.robot_page import RobotPage
from dqcontrol.browser.run_view_model import Track

__all__ = ["GrowingRecording", "LiveRun", "Page", "RobotPage", "Track", "growing_recording"]
