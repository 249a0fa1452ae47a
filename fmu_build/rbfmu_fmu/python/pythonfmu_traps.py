"""Traps of pythonfmu 0.6.8 to 0.7.0, each with what would happen, and how this FMU stays out of it.

It is bundled into every FMU. All that rests on how pythonfmu works inside stands here, but for what its interface
cannot say otherwise: an exception is fmi2Fatal, a `do_step` that returns False is fmi2Discard with fmi2Terminated;
there is no third way to refuse. Which of its files an FMU has, `builder` says.
"""

import atexit
import contextlib
import ctypes
import os
import re
import sys
import threading
from typing import Any

from .call_rules import LOG_CATEGORIES

CRASHES_IN_PATH = re.compile(r"[^A-Za-z0-9_.~/ -]" if os.name == "posix" else r"[^A-Za-z0-9_.~/ :\\-]")
"""Characters of the folder of an unzipped FMU that a URI spells otherwise, all but the space: the library looks for the
FMU where the URI points to as it is spelled, finds no class there, and calls it all the same. This ends the process."""

CATEGORIES = (*LOG_CATEGORIES, "cppfmu")
"""The categories of all messages that have one; the last is the library's."""

clear_error = ctypes.pythonapi.PyErr_Clear
"""Clears the error of a slave, which is still set when pythonfmu calls the importer's logger about it."""
_increment = ctypes.pythonapi.Py_IncRef
_increment.argtypes, _increment.restype = [ctypes.py_object], None

_LIBRARIES: set[str] = set()  # of pythonfmu's, that this FMU was loaded from


def keep_script(names: dict[str, object]) -> None:
    """Keep the dict of the FMU's script alive: the library releases it, though not its own, at every instantiation."""
    _increment(names)


def keep_after_exception(instance: Any) -> None:
    """Keep alive what is released twice, once after the exception and once when freed: the process would end."""
    for one in (type(instance), instance, instance.log_queue):
        _increment(one)


def forget_resources(folder: str) -> None:
    """Take the folder from `sys.path`, where each instance adds it; all that it is needed for has been imported."""
    while folder in sys.path:
        sys.path.remove(folder)
    sys.path_importer_cache.pop(folder, None)


def reference_given(reference: int) -> int:
    """Return the value reference that the importer gave: those from 2^31 on arrive as negative numbers."""
    return reference % 2**32


class _Logger(ctypes.Structure):
    """The library's logger of an instance, a C++ object: what is asked for, and the name that messages come with."""

    _fields_ = (
        ("functions", ctypes.c_void_p),
        ("is_on", ctypes.c_bool),
        ("name", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("short_name", ctypes.c_char * 16),
        ("first_category", ctypes.c_void_p),
        ("no_category", ctypes.c_void_p),
        ("end", ctypes.c_void_p),
    )


def drop_messages_without_category(logger: int, name: str) -> None:
    """Ask the library, where all messages are wanted, for those of all categories: it has some of its own without one.

    These come with NULL for a category when a call is refused, after our own message of it, and end OMSimulator.
    logger: address of an instance's logger; it is left alone where `name`, the instance's, is not where it should be.
    """
    seen, spelled = _Logger.from_address(logger), name.encode()
    if sys.platform != "linux" or seen.length != len(spelled) or ctypes.string_at(seen.name, seen.length) != spelled:
        return
    library = _library_of(logger)
    if library is None or not seen.is_on or seen.first_category != seen.no_category:
        return
    names = (ctypes.c_char_p * len(CATEGORIES))(*(category.encode() for category in CATEGORIES))
    component = (ctypes.c_void_p * 8)(*[logger] * 8)  # of an instance, the call looks at the logger alone
    _loaded(library).fmi2SetDebugLogging(component, 1, ctypes.c_size_t(len(names)), names)


class HeldGil:
    """A lock that spares a host without Python the thread state that the library makes in each call (15 us).

    RBFMU_HOLD_GIL=1 asks for it, in a host that calls from one thread: the interpreter's lock is kept meanwhile.
    """

    def __init__(self) -> None:
        self._thread: int | None = None

    def hold(self) -> None:
        """Take the lock once more, and keep it."""
        if os.environ.get("RBFMU_HOLD_GIL") == "1" and self._thread is None:
            ctypes.pythonapi.PyGILState_Ensure()
            self._thread = threading.get_ident()

    def release(self) -> None:
        """Give it back, in the thread that took it."""
        if self._thread is not None and self._thread == threading.get_ident():
            self._thread = None
            ctypes.pythonapi.PyGILState_Release(ctypes.c_int(0))


def release_at_exit(logger: int) -> None:
    """Save the end of a process from the library, which there, still loaded, releases its interpreter twice.

    logger: address of a C++ object of it, whose first word points into it. In a host without Python the library also
    stays loaded to the end: it would take the interpreter from other FMUs, and Numba cannot start in a second one.
    """
    library = _library_of(logger) if sys.platform == "linux" else None
    if library is None or library in _LIBRARIES:
        return
    if not sys.orig_argv:
        release = ctypes.cast(_loaded(library).finalizePythonInterpreter, ctypes.c_void_p)
        ctypes.CDLL(None).__cxa_atexit(release, None, None)
    elif not _LIBRARIES:
        atexit.register(_release)
    _LIBRARIES.add(library)


def _library_of(logger: int) -> str | None:
    """Return the file of the library whose C++ object stands at an address: the object's first word points into it."""
    symbol, table = (ctypes.c_char_p * 4)(), ctypes.c_void_p.from_address(logger)  # Dl_info: first of all the file
    return os.fsdecode(symbol[0] or b"") if ctypes.CDLL(None).dladdr(table, symbol) else None


def _release() -> None:
    for library in _LIBRARIES:
        with contextlib.suppress(OSError):  # it has been unloaded, and released
            _loaded(library).finalizePythonInterpreter()


def _loaded(library: str) -> ctypes.CDLL:
    """Return a library that is loaded, and keep it so; raise OSError where it is not."""
    return ctypes.CDLL(library, os.RTLD_NOW | os.RTLD_NOLOAD)
