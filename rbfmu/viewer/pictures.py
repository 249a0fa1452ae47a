"""Which instants of a motion are shown, and how long showing them takes."""

import math
from typing import NamedTuple

FPS = 30.0
"""Pictures a second."""
REAL_TIME = (4.0, 60.0)
"""Spans (s) that are shown as they pass; others take `PLAYED` s."""
PLAYED = 20.0
MAX_PICTURES = 3000
MAX_TURN = 0.25
"""The largest angle (rad) from one picture to the next; a faster spin is played slower."""
FEWEST = 5.0
"""Pictures a second, where no more instants are known."""


class Pictures(NamedTuple):
    """How many pictures, and how long they are played (s)."""

    number: int
    played: float


def pictures(span: float, largest_rate: float, rows: float = math.inf) -> Pictures:
    """Return the pictures of a span (s) in which the body turns at most this fast (rad/s); rows: instants known."""
    played = span if REAL_TIME[0] <= span <= REAL_TIME[1] else PLAYED
    smooth = min(max(FPS * played, largest_rate * span / MAX_TURN), MAX_PICTURES - 1.0)
    return Pictures(int(min(math.ceil(smooth) + 1, rows)), min(smooth / FPS, rows / FEWEST))
