"""Runs in a browser: `Track` is what there is to see of one, `Page` shows them."""

from dqcontrol.view.browser.live import GrowingRecording, LiveRun, growing_recording
from dqcontrol.view.browser.page import Page
from dqcontrol.view.browser.track import Track

__all__ = ["GrowingRecording", "LiveRun", "Page", "Track", "growing_recording"]
