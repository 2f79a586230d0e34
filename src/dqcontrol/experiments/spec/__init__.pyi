from .spec import (
    AnyLaw as AnyLaw,
)
from .spec import (
    AnyPlant as AnyPlant,
)
from .spec import (
    HandStart as HandStart,
)
from .spec import (
    MetricsFrom as MetricsFrom,
)
from .spec import (
    RobotSpec as RobotSpec,
)
from .spec import (
    Spec as Spec,
)
from .spec import (
    Start as Start,
)
from .spec import (
    StartedRobotSpec as StartedRobotSpec,
)
from .spec import (
    as_spec as as_spec,
)
from .spec import (
    quantities_at as quantities_at,
)
from .spec import (
    read_data as read_data,
)
from .spec import (
    read_spec as read_spec,
)
from .spec import (
    spec_text as spec_text,
)
from .spec import (
    start_configuration as start_configuration,
)
