from .jog import Jog as Jog
from .keyboard import Keyboard as Keyboard
