"""Types of arrays, by what stands in them."""

import numpy as np
from numpy.typing import ArrayLike as ArrayLike, NDArray as NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Buffer = Array
"""A model's memory: all of its blocks, one after another."""
Motion = dict[str, Array]
"""Rows of each quantity, by its name, at points in time."""
