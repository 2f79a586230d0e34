from .catalogue import (
    SAMPLES as SAMPLES,
)
from .catalogue import (
    SOURCES as SOURCES,
)
from .catalogue import (
    Experiment as Experiment,
)
from .catalogue import (
    catalogue_table as catalogue_table,
)
from .catalogue import (
    chosen_plant as chosen_plant,
)
from .catalogue import (
    experiments as experiments,
)
from .catalogue import (
    names as names,
)
from .printed import (
    Claim as Claim,
)
from .printed import (
    PublishedCell as PublishedCell,
)
from .reproduce_one import (
    is_finished as is_finished,
)
from .reproduce_one import (
    reproduce as reproduce,
)
from .reproduced import Reproduced as Reproduced
