"""Types of arrays and ranges that every room uses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Expression = Any
"""A float, an array or a CasADi expression."""
Range = tuple[float, float]
