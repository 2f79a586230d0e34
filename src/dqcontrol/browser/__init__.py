"""Runs in a browser: `Track` is what there is to see of one, `Page` shows them."""

from dqcontrol.browser.live import GrowingRecording, LiveRun, growing_recording
from dqcontrol.browser.page import Page
from dqcontrol.browser.run_view_model import Track

__all__ = ["GrowingRecording", "LiveRun", "Page", "Track", "growing_recording"]
