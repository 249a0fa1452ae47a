"""The entry point of `python -m rbfmu` and of the command `rbfmu`.

Ctrl-C ends it with exit status 130 and no traceback, wherever it strikes.
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
"""Objects between two searches for garbage: a command imports and compiles a million that stay until its end."""

STATUS = 130
"""128 and the number of SIGINT: what shells expect."""

SOON = 0.05
"""s"""


def main() -> None:
    """Run the command line, whose imports take long enough for a Ctrl-C."""
    gc.set_threshold(YOUNG)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # or NumPy starts threads that no command needs
    atexit.register(gc.freeze)  # at the end all goes anyway
    with interruptible():
        from rbfmu.cli import main as command

        command(prog_name="rbfmu")


@contextmanager
def interruptible() -> Iterator[None]:
    """Let what is inside clean up and then exit, whoever has caught the KeyboardInterrupt on its way.

    Where Python can only report it (in a callback from C, in a finaliser) it is raised anew.
    """
    struck = False
    reported = sys.unraisablehook

    def strike(*_: object) -> NoReturn:
        nonlocal struck
        struck = True
        if llvm := sys.modules.get("llvmlite.binding.ffi"):  # may have freed what it has not noted yet; all goes anyway
            llvm.ObjectRef.__del__ = lambda _: None
        raise KeyboardInterrupt

    def raise_anew(unraisable: "sys.UnraisableHookArgs") -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            threading.Timer(SOON, _strike_main_thread).start()  # here it could only be reported again
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
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)  # wakes it up as well
    else:
        _thread.interrupt_main()


def leave() -> NoReturn:
    """Exit with status 130: where the interrupt passed through `exec`, Python itself would end by the signal."""
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # a stream may be closed, or none from the start
            stream.flush()
    os._exit(STATUS)


if __name__ == "__main__":
    main()
