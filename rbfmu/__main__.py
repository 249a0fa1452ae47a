"""The entry point of `python -m rbfmu` and of the command `rbfmu`.

Ctrl-C ends it at any time, with exit status 130 and without a traceback.
"""

import _thread
import atexit
import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

YOUNG = 200_000
"""New objects between two garbage collections: importing and compiling make a million that stay until the end."""

STATUS = 130
"""128 plus the number of SIGINT, as shells expect."""

SOON = 0.05
"""The time in s after which an interrupt that Python could only report is raised again."""


def main() -> None:
    """Run the command line; its imports take so long that Ctrl-C may come during them."""
    gc.set_threshold(YOUNG)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # else NumPy starts threads that no command needs
    os.environ["MPLBACKEND"] = "agg"  # no command shows a window; Matplotlib refuses a name that it does not know
    atexit.register(gc.freeze)  # at the end of the process no garbage needs to be collected
    with interruptible():
        from rbfmu.cli import main as command

        command(prog_name="rbfmu")


@contextmanager
def interruptible() -> Iterator[None]:
    """After Ctrl-C, let the code inside clean up, and then exit even if something has caught the KeyboardInterrupt.

    If Python can only report the interrupt (in a callback from C, in a finaliser), it is raised again.
    """
    struck = False
    reported = sys.unraisablehook

    def strike(*_: object) -> NoReturn:
        nonlocal struck
        struck = True
        if llvm := sys.modules.get("llvmlite.binding.ffi"):  # else it might free twice what an interrupted call freed
            llvm.ObjectRef.__del__ = lambda _: None
        raise KeyboardInterrupt

    def raise_anew(unraisable: "sys.UnraisableHookArgs") -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            threading.Timer(SOON, _strike_main_thread).start()  # raised here, it would only be reported again
        else:
            reported(unraisable)

    before = signal.signal(signal.SIGINT, strike)
    sys.unraisablehook = raise_anew
    try:
        yield
    except BaseException:
        if not struck:
            raise
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN if struck else before)
        sys.unraisablehook = reported
    if struck:
        leave()


def _strike_main_thread() -> None:
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)  # this also wakes the thread up
    else:
        _thread.interrupt_main()


def leave() -> NoReturn:
    """Exit with status 130; if the interrupt passed through `exec`, Python itself would end by the signal instead."""
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # a stream may be closed, or never have been open
            stream.flush()
    os._exit(STATUS)


if __name__ == "__main__":
    main()
