"""What the arrays of the camera are made of."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]  # a picture in grey levels, (height, width)
