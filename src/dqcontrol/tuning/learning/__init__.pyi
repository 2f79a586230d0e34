from .convergence import Convergence as Convergence
from .learn_spec import LearnBlock as LearnBlock
from .run_learning import (
    Learning as Learning,
    LearningRun as LearningRun,
    learn as learn,
    learn_to as learn_to,
)
