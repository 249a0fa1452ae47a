"""Warnings of array functions at singular arguments, in their own words; NumPy would speak of a division by zero."""

import sys
import warnings
from collections.abc import Callable

import numpy as np

Singular = Callable[..., bool]


def warn_of_singular(message: str) -> None:
    """Give a RuntimeWarning at the caller's line, unless NumPy's error state for divisions forbids it."""
    mode = np.geterr()["divide"]
    if mode == "raise":
        raise FloatingPointError(message)
    if mode != "ignore":
        warnings.warn(message, RuntimeWarning, stacklevel=_frames_of_this_package())


def _frames_of_this_package() -> int:
    """Return how many frames up the stack the first one outside this package is."""
    level, frame = 0, sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__", "").startswith("rbfmu."):
        level, frame = level + 1, frame.f_back  # type: ignore[assignment]
    return level + 1
