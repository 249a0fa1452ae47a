"""Types of arrays, by what stands in them."""

from numpy.typing import ArrayLike as ArrayLike, NDArray as NDArray

from rbfmu_kernels.types import Array as Array, Indices as Indices

Buffer = Array
"""A model's memory: all of its blocks, one after another."""
Motion = dict[str, Array]
"""Rows of each quantity, by its name, at points in time."""
