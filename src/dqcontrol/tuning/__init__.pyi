from .learning_convergence import Convergence as Convergence
from .run_learning import (
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
from .spec_blocks import (
    LearnBlock as LearnBlock,
    TuneBlock as TuneBlock,
)
