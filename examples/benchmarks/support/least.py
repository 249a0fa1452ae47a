"""The least times of calls in turn: of all statistics what else runs meanwhile changes it least."""

import math
from collections.abc import Callable
from time import perf_counter
from typing import Any


def least(
    rounds: int,
    calls: dict[str, Callable[[], Any]],
    block: float = 0.0,
    most: float = math.inf,
    clock: Callable[[], float] = perf_counter,
) -> dict[str, float]:
    """Return the least seconds of each call, which are taken in turn; the first round also compiles.

    block: for how long, s, a call is repeated in each round after that; most: the time, s, after which a call is
    taken no more.
    """
    found, repeats, spent = dict.fromkeys(calls, math.inf), dict.fromkeys(calls, 1), dict.fromkeys(calls, 0.0)
    for _ in range(rounds):
        for name, call in calls.items():
            if spent[name] > most:
                continue
            begin = clock()
            for _ in range(repeats[name]):
                call()
            seconds = clock() - begin
            spent[name] += seconds
            found[name] = min(found[name], seconds / repeats[name])
            repeats[name] = max(round(block * repeats[name] / seconds), 1)
    return found
