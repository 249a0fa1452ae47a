"""Types of arrays, by their content."""

from numpy.typing import ArrayLike as ArrayLike, NDArray as NDArray

from rbfmu_kernels.types import Array as Array, Indices as Indices

Buffer = Array
"""The memory of a model: all its blocks, one after another."""
Motion = dict[str, Array]
"""The rows of each quantity at points in time, by its name."""
