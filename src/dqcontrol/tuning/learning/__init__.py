"""Learning from repetition: the reference is shifted from repeat to repeat until the hand goes where it should."""

from dqcontrol.tuning.learning.convergence import Convergence
from dqcontrol.tuning.learning.learn_spec import LearnBlock
from dqcontrol.tuning.learning.run_learning import Learning, LearningRun, learn, learn_to

__all__ = ["Convergence", "LearnBlock", "Learning", "LearningRun", "learn", "learn_to"]
