from .servo_plant import (
    Servo as Servo,
    load_servo as load_servo,
)
