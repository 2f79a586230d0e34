from .haptics import Haptics as Haptics
from .jog import (
    Jog as Jog,
    Keyboard as Keyboard,
)
from .teleoperation import (
    Gamepad as Gamepad,
    Input as Input,
    LeaderArm as LeaderArm,
    SpaceMouse as SpaceMouse,
    Teleoperation as Teleoperation,
    Told as Told,
)
from .web_xr import WebXr as WebXr
