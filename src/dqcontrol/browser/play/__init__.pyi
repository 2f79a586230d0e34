from .notebook import (
    ShownPlay as ShownPlay,
    play as play,
)
from .play_page import PlayPage as PlayPage
from .scenes import (
    SCENES as SCENES,
    Scene as Scene,
)
from .session import PlaySession as PlaySession
