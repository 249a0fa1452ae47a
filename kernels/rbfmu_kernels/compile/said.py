"""Lines on stderr for those who wait, as where compiling takes long; `RBFMU_QUIET` silences them."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread, Timer
from typing import Any

from . import numba_private

PATIENCE = 2.0
"""The time, s, after which work other than compiling says what it is."""

NAME = "rbfmu: a line for those who wait"
"""The thread's."""


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
        while before != now or Announcer.begun > Announcer.ended:
            before = Announcer.begun
            if done.wait(patience):
                return
            now = Announcer.begun
        say(text())

    Thread(target=wait, name=NAME, daemon=True).start()
    try:
        yield
    finally:
        done.set()


COMPILING_PATIENCE = 1.0
"""The time, s, after which compiling says so."""
TEXT = "rbfmu: compiling for the first time takes some seconds; where the code can be kept, it happens once"
_Listener: Any = getattr(numba_private, "Listener", object)  # where Numba has none, nothing is announced


class Announcer(_Listener):  # type: ignore[misc]
    """A listener that waits from the outermost start of a compilation of ours to its end, and speaks once.

    begun, ended: how many compilations did so in this process, as far as such listeners hear of them.
    """

    begun = ended = 0

    def __init__(self) -> None:
        self._spoken = False
        self._timer = Timer(COMPILING_PATIENCE, self._say)

    def on_start(self, event: Any) -> None:
        """Begin to wait."""
        if Announcer.begun == Announcer.ended and not self._spoken and _is_ours(event):
            self._timer = Timer(COMPILING_PATIENCE, self._say)
            self._timer.daemon = True
            self._timer.start()
        Announcer.begun += 1

    def on_end(self, event: Any) -> None:
        """Wait no longer."""
        Announcer.ended += 1
        if Announcer.begun == Announcer.ended:
            self._timer.cancel()

    def _say(self) -> None:
        self._spoken = True
        say(TEXT)


def _is_ours(compilation: Any) -> bool:
    module = getattr(compilation.data["dispatcher"].py_func, "__module__", None) or ""
    return str(module).partition(".")[0].partition("_")[0] == "rbfmu"
