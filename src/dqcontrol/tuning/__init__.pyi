from .front_search import (
    hypervolume as hypervolume,
)
from .front_search import (
    nondominated as nondominated,
)
from .front_search import (
    search_front as search_front,
)
from .learning import (
    Convergence as Convergence,
)
from .learning import (
    LearnBlock as LearnBlock,
)
from .learning import (
    Learning as Learning,
)
from .learning import (
    LearningRun as LearningRun,
)
from .learning import (
    learn as learn,
)
from .learning import (
    learn_to as learn_to,
)
from .run_tuning import (
    TunedLaw as TunedLaw,
)
from .run_tuning import (
    Tuning as Tuning,
)
from .run_tuning import (
    tune as tune,
)
from .run_tuning import (
    tune_to as tune_to,
)
from .tune_spec import TuneBlock as TuneBlock
