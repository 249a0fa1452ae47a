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


REFLECTION = "some of these matrices are no rotations (det <= 0, as of a reflection), which gives NaN"
NO_DIRECTION = "some of these axes have no direction (zero, or beyond 1e150), which gives NaN"
NEGATIVE = "some of these masses or sizes are negative, which gives NaN"
FULL_TURN = "some of these rotation vectors are full turns (|u| = 2 pi n, n >= 1), where they have no rates"


def gimbal_lock(seq: str) -> str:
    """Return what is said of rates of Euler angles."""
    return (
        f"some of these Euler angles {seq} are in gimbal lock (|det E| < 4 eps: the middle angle is {_poles(seq)} "
        "deg), where they have no rates"
    )


def at_pole(seq: str) -> str:
    """Return what is said of Euler angles of rotations."""
    return (
        f"some of these rotations are at a pole of {seq} (middle angle {_poles(seq)} deg): the third angle is set to 0"
    )


def at_pole_or_reflection(seq: str) -> str:
    """Return what is said of Euler angles of matrices."""
    return f"{at_pole(seq)}; or {REFLECTION}"


def _poles(seq: str) -> str:
    return "0 or 180" if seq[0] == seq[2] else "-90 or 90"
