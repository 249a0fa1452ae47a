"""Messages on stderr to a user who waits, for example while code compiles; `RBFMU_QUIET` silences them."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread, Timer
from typing import Any

from . import numba_private

PATIENCE = 2.0
"""The time, s, after which work other than compiling is announced."""

NAME = "rbfmu: a line for those who wait"
"""The name of the thread that waits."""


def say(text: str) -> None:
    """Print a line on stderr, if there is one that takes it; `print` would take stdout for one that is None."""
    if sys.stderr is not None and not os.environ.get("RBFMU_QUIET"):
        with suppress(OSError, ValueError):
            print(text, file=sys.stderr, flush=True)


@contextmanager
def said_after(patience: float, text: Callable[[], str]) -> Iterator[None]:
    """Print `text()` once the body has run for `patience` s without compiling, which has its own announcement.

    Where no thread can be started, as in a container that bounds their number, nothing is printed.
    """
    done = Event()

    def wait() -> None:
        before, now = -1, 0
        while before != now or Announcer.begun > Announcer.ended:
            before = Announcer.begun
            if done.wait(patience):
                return
            now = Announcer.begun
        say(text())

    with suppress(RuntimeError):
        Thread(target=wait, name=NAME, daemon=True).start()
    try:
        yield
    finally:
        done.set()


COMPILING_PATIENCE = 1.0
"""The time, s, after which compiling is announced."""
TEXT = "rbfmu: compiling for the first time takes some seconds; where the code can be kept, it happens once"
_Listener: Any = getattr(numba_private, "Listener", object)  # where Numba has none, nothing is announced


class Announcer(_Listener):  # type: ignore[misc]
    """A listener to Numba's events that announces, once, a compilation of our functions that takes long.

    It measures the time from the beginning of the outermost compilation to its end. begun, ended: how many compilations
    listeners have seen begin and end in this process.
    """

    begun = ended = 0

    def __init__(self) -> None:
        self._spoken = False
        self._timer = Timer(COMPILING_PATIENCE, self._say)

    def on_start(self, event: Any) -> None:
        """Start the timer at an outermost compilation of ours."""
        if Announcer.begun == Announcer.ended and not self._spoken and _is_ours(event):
            self._timer = Timer(COMPILING_PATIENCE, self._say)
            self._timer.daemon = True
            with suppress(RuntimeError):  # as above
                self._timer.start()
        Announcer.begun += 1

    def on_end(self, event: Any) -> None:
        """Stop the timer at the end of an outermost compilation."""
        Announcer.ended += 1
        if Announcer.begun == Announcer.ended:
            self._timer.cancel()

    def _say(self) -> None:
        self._spoken = True
        say(TEXT)


def _is_ours(compilation: Any) -> bool:
    module = getattr(compilation.data["dispatcher"].py_func, "__module__", None) or ""
    return str(module).partition(".")[0].partition("_")[0] == "rbfmu"
