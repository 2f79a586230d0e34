"""Random scenes for constrained laws: a Panda among things in its way, and what shows that none was touched."""

import numpy as np

HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7])
SUBSAMPLES = 20
# The first two links cannot get out of the way of what comes.
MOVED = [f"panda_link{k}" for k in (3, 4, "5.1", "5.2", "6.1", "6.2", 7)]
