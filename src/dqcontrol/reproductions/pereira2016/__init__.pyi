from .pereira2016_catalogue import (
    EXPERIMENTS as EXPERIMENTS,
)
from .pereira2016_catalogue import (
    PLANTS as PLANTS,
)
from .published_numbers import (
    REPRODUCTIONS as REPRODUCTIONS,
)
from .published_numbers import (
    Disagreement as Disagreement,
)
from .published_numbers import (
    PublishedRun as PublishedRun,
)
from .published_numbers import (
    claims as claims,
)
from .published_numbers import (
    disagreements as disagreements,
)
from .published_numbers import (
    published_cells as published_cells,
)
from .published_numbers import (
    published_runs as published_runs,
)
from .published_specs import published_spec as published_spec
from .reproduce_pereira2016 import reproduce as reproduce
