from .catalogue import (
    SAMPLES as SAMPLES,
    SOURCES as SOURCES,
    Experiment as Experiment,
    catalogue_table as catalogue_table,
    chosen_plant as chosen_plant,
    experiments as experiments,
    names as names,
)
from .printed import (
    Claim as Claim,
    PublishedCell as PublishedCell,
)
from .reproduced import (
    Reproduced as Reproduced,
    is_finished as is_finished,
    reproduce as reproduce,
)
