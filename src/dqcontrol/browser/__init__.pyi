from .drawn import DrawnRobot as DrawnRobot
from .live import (
    GrowingRecording as GrowingRecording,
    LiveRun as LiveRun,
    growing_recording as growing_recording,
)
from .page import Page as Page
from .play import (
    PlayPage as PlayPage,
    PlaySession as PlaySession,
)
from .replay import replay_page as replay_page
from .robot_page import RobotPage as RobotPage
from .run_view_model import Track as Track
