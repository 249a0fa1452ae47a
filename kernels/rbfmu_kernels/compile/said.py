"""Lines on stderr for those who wait; `RBFMU_QUIET` silences them."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

PATIENCE = 2.0
"""The time, s, after which work other than compiling says what it is."""

NAME = "rbfmu: a line for those who wait"
"""The thread's."""


class Compilations:
    """How many compilations began and ended in this process, as far as `announcement` hears of them."""

    begun = ended = 0


def say(text: str) -> None:
    """Print a line on stderr."""
    if not os.environ.get("RBFMU_QUIET"):
        print(text, file=sys.stderr, flush=True)


@contextmanager
def said_after(patience: float, text: Callable[[], str]) -> Iterator[None]:
    """Print a line once the body has run for `patience` s on end without compiling, which is announced by itself."""
    done = Event()

    def wait() -> None:
        before, now = -1, 0
        while before != now or Compilations.begun > Compilations.ended:
            before = Compilations.begun
            if done.wait(patience):
                return
            now = Compilations.begun
        say(text())

    Thread(target=wait, name=NAME, daemon=True).start()
    try:
        yield
    finally:
        done.set()
