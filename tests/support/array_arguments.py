"""Arguments for array functions, and all these functions by their names."""

import numpy as np
import pytest
from numba import config

import rbfmu
from rbfmu import arrays
from tests.support.references.hard_cases import random_quaternions, random_vectors, rotation_matrices

ARRAY_FUNCTIONS = {name: f for name in arrays.__all__ if hasattr(f := getattr(rbfmu, name), "__wrapped__")}
Q = np.array(random_quaternions(100, 71))
V = np.array(random_vectors(100, 72))
R = np.array(rotation_matrices(random_quaternions(100, 73)))
compiled_only = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="needs the compiled functions")
