from .gamepad import Gamepad as Gamepad
from .haptics import Haptics as Haptics
from .jog import Jog as Jog
from .keyboard import Keyboard as Keyboard
from .leader_arm import LeaderArm as LeaderArm
from .space_mouse import SpaceMouse as SpaceMouse
from .teleoperation import (
    Input as Input,
    Teleoperation as Teleoperation,
    Told as Told,
)
from .web_xr import WebXr as WebXr
