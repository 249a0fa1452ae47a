"""One line on stderr where compiling a kernel takes long: that it does, and that it happens once."""

from threading import Timer
from typing import Any

from .numba_private import Listener, register
from .said import Compilations, say

PATIENCE = 1.0
"""The time, s, after which the line is printed."""
TEXT = "rbfmu: compiling for the first time takes some seconds; where the code can be kept, it happens once"


class Announcer(Listener):  # type: ignore[misc]
    """A listener that waits from the outermost start of a compilation of ours to its end, and speaks once."""

    def __init__(self) -> None:
        self._depth, self._spoken = 0, False
        self._timer = Timer(PATIENCE, self._say)

    def on_start(self, event: Any) -> None:
        """Begin to wait."""
        if self._depth == 0 and not self._spoken and _is_ours(event):
            self._timer = Timer(PATIENCE, self._say)
            self._timer.daemon = True
            self._timer.start()
        self._depth += 1
        Compilations.begun += 1

    def on_end(self, event: Any) -> None:
        """Wait no longer."""
        self._depth -= 1
        Compilations.ended += 1
        if self._depth == 0:
            self._timer.cancel()

    def _say(self) -> None:
        self._spoken = True
        say(TEXT)


def _is_ours(compilation: Any) -> bool:
    module = getattr(compilation.data["dispatcher"].py_func, "__module__", None) or ""
    return str(module).partition(".")[0].partition("_")[0] == "rbfmu"


def announce_compilation() -> None:
    """Let long compilations be announced in this process."""
    register("numba:compile", Announcer())
