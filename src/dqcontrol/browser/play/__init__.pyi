from .play_page import (
    PlayPage as PlayPage,
    ShownPlay as ShownPlay,
    play as play,
)
from .scenes import (
    SCENES as SCENES,
    Scene as Scene,
)
from .session import PlaySession as PlaySession
