from .drawn_robot import DrawnRobot as DrawnRobot
from .live import (
    GrowingRecording as GrowingRecording,
    LiveRun as LiveRun,
    growing_recording as growing_recording,
)
from .page import Page as Page
from .robot_page import RobotPage as RobotPage
from .run_view_model import Track as Track
