from .clock import (
    Clock as Clock,
    Timing as Timing,
)
from .closed_loop import (
    Stop as Stop,
    Trace as Trace,
    close_loop as close_loop,
)
from .live import (
    Live as Live,
    LiveState as LiveState,
)
from .record import (
    Record as Record,
    has_failed as has_failed,
    part_of as part_of,
)
from .signals import Signal as Signal
from .simulate import (
    simulate as simulate,
    simulate_prepared as simulate_prepared,
)
from .supervision import Supervision as Supervision
