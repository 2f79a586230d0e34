from .servo_file import load_servo as load_servo
from .servo_plant import Servo as Servo
