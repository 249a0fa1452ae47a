"""Warnings of array functions at singular arguments, in their own words; NumPy would speak of a division by zero."""

import sys
import warnings
from collections.abc import Callable

import numpy as np

Singular = Callable[..., bool]


def warn_of_singular(message: str) -> None:
    """A RuntimeWarning at the caller's line; NumPy's error state for divisions may silence it or make it an error."""
    mode = np.geterr()["divide"]
    if mode == "raise":
        raise FloatingPointError(message)
    if mode != "ignore":
        warnings.warn(message, RuntimeWarning, stacklevel=_frames_of_this_package())


def _frames_of_this_package() -> int:
    """How many frames up the stack, from the calling function on, the first one outside this package is."""
    level, frame = 0, sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__", "").startswith("rbfmu."):
        level, frame = level + 1, frame.f_back  # type: ignore[assignment]
    return level + 1
