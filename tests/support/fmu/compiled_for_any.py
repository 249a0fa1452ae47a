"""Prints the hash of a model's object code: of loops, of which LLVM makes other code for other processors.

One is in the model, one in what it calls, and one in a function of Numba's own.
"""

import hashlib
from types import ModuleType

import numpy as np

from rbfmu_fmu.native.object_code import object_files
from rbfmu_fmu.native.platforms import PLATFORMS
from rbfmu_kernels.compile.decorator import kernel


@kernel(inline=False)
def differences(z):
    for k in range(64):
        z[k] -= z[64 + k]
    return z.view(np.int64).sum()


@kernel(inline=False)
def step(z, h):
    for k in range(64):
        z[k] = z[k] * h + z[64 + k]
    return differences(z)


if __name__ == "__main__":
    model = ModuleType("model")
    model.step, model.SIZE = step, 128
    found = object_files(model, PLATFORMS["linux64"])
    print(hashlib.sha256(b"".join(found.values())).hexdigest())
