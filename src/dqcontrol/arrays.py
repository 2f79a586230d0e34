"""The type of the arrays that this package takes and returns."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
