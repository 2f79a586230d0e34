"""Position servos, of arms and of whole bodies."""

from dqcontrol.plants.servo.servo_file import load_servo
from dqcontrol.plants.servo.servo_plant import Servo

__all__ = [
    "Servo",
    "load_servo",
]
