from .learning import (
    Convergence as Convergence,
    LearnBlock as LearnBlock,
    Learning as Learning,
    LearningRun as LearningRun,
    learn as learn,
    learn_to as learn_to,
)
from .run_tuning import (
    TunedLaw as TunedLaw,
    Tuning as Tuning,
    tune as tune,
    tune_to as tune_to,
)
from .searches import (
    hypervolume as hypervolume,
    nondominated as nondominated,
    search_front as search_front,
)
from .tune_spec import TuneBlock as TuneBlock
