from .gamepad import Gamepad as Gamepad
from .haptics import Haptics as Haptics
from .jog import (
    Jog as Jog,
    Keyboard as Keyboard,
)
from .space_mouse import SpaceMouse as SpaceMouse
from .teleoperation import (
    Input as Input,
    LeaderArm as LeaderArm,
    Teleoperation as Teleoperation,
    Told as Told,
)
from .web_xr import WebXr as WebXr
