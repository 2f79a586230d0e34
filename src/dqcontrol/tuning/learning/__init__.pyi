from .convergence import Convergence as Convergence
from .learn_spec import LearnBlock as LearnBlock
from .run_learning import (
    Learning as Learning,
)
from .run_learning import (
    LearningRun as LearningRun,
)
from .run_learning import (
    learn as learn,
)
from .run_learning import (
    learn_to as learn_to,
)
