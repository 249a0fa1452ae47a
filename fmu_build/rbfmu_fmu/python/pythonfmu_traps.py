"""Traps of pythonfmu 0.6.8 to 0.7.0: what would happen, and how this FMU avoids it.

It is bundled into every pythonfmu FMU. All that depends on the internals of pythonfmu is here. One thing its interface
does not allow to change: an exception is fmi2Fatal, a `do_step` that returns False is fmi2Discard with fmi2Terminated;
there is no other way to refuse. `builder` decides which of its files an FMU contains.
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
"""Characters in the folder of an unzipped FMU that are escaped in a URI, except the space. The library looks for the
FMU in the folder as the URI spells it, finds no class there, but calls it all the same, which ends the process."""

CATEGORIES = (*LOG_CATEGORIES, "cppfmu")
"""The categories of all messages that have one; the last is that of pythonfmu's library."""

clear_error = ctypes.pythonapi.PyErr_Clear
"""Clear the exception of a slave, which is still set when pythonfmu calls the importer's logger about it."""
_increment = ctypes.pythonapi.Py_IncRef
_increment.argtypes, _increment.restype = [ctypes.py_object], None

_LIBRARIES: set[str] = set()  # the files of pythonfmu's library from which this FMU was loaded


def keep_script(names: dict[str, object]) -> None:
    """Keep the dict of the FMU's script alive: the library releases it at each instantiation without owning it."""
    _increment(names)


def keep_after_exception(instance: Any) -> None:
    """Keep alive what the library releases twice, after an exception and when freed, which would end the process."""
    for item in (type(instance), instance, instance.log_queue):
        _increment(item)


def forget_resources(folder: str) -> None:
    """Remove the folder from `sys.path`, to which each instance adds it; everything in it has been imported."""
    while folder in sys.path:
        sys.path.remove(folder)
    sys.path_importer_cache.pop(folder, None)


def reference_given(reference: int) -> int:
    """Return the value reference that the importer gave; those from 2^31 on arrive as negative numbers."""
    return reference % 2**32


class _Logger(ctypes.Structure):
    """The library's logger of an instance, a C++ object: the categories asked for, and the name in its messages."""

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
    """If all messages are wanted, ask the library for those of all categories, which drops those without a category.

    The library sends some of its own with NULL as category after a call is refused, and these end OMSimulator.
    logger: the address of the instance's logger; nothing is done if the instance's name is not at its place there.
    """
    seen, spelled = _Logger.from_address(logger), name.encode()
    if sys.platform != "linux" or seen.length != len(spelled) or ctypes.string_at(seen.name, seen.length) != spelled:
        return
    library = _library_of(logger)
    if library is None or not seen.is_on or seen.first_category != seen.no_category:
        return
    names = (ctypes.c_char_p * len(CATEGORIES))(*(category.encode() for category in CATEGORIES))
    component = (ctypes.c_void_p * 8)(*[logger] * 8)  # the call uses nothing but the logger of an instance
    _loaded(library).fmi2SetDebugLogging(component, 1, ctypes.c_size_t(len(names)), names)


class HeldGil:
    """The interpreter's lock, held between calls, so that the library needs no new thread state in each call (15 us).

    This is for hosts without Python that make all calls from one thread; RBFMU_HOLD_GIL=1 switches it on.
    """

    def __init__(self) -> None:
        self._thread: int | None = None

    def hold(self) -> None:
        """Acquire the lock and keep it, if it is asked for."""
        if os.environ.get("RBFMU_HOLD_GIL") == "1" and self._thread is None:
            ctypes.pythonapi.PyGILState_Ensure()
            self._thread = threading.get_ident()

    def release(self) -> None:
        """Release the lock, if this is the thread that holds it."""
        if self._thread is not None and self._thread == threading.get_ident():
            self._thread = None
            ctypes.pythonapi.PyGILState_Release(ctypes.c_int(0))


def release_at_exit(logger: int) -> None:
    """Prevent a crash at the end of a process, where the library, if still loaded, releases its interpreter twice.

    logger: the address of one of its C++ objects, whose first word points into the library. In a host without Python
    the library also stays loaded until the end: unloading it would end the interpreter that other FMUs use, and Numba
    cannot start in a second one.
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
    """Return the file of the library to which a C++ object belongs: its first word points into the library."""
    symbol, table = (ctypes.c_char_p * 4)(), ctypes.c_void_p.from_address(logger)  # Dl_info: first of all the file
    return os.fsdecode(symbol[0] or b"") if ctypes.CDLL(None).dladdr(table, symbol) else None


def _release() -> None:
    for library in _LIBRARIES:
        with contextlib.suppress(OSError):  # it has been unloaded, and so has released its interpreter
            _loaded(library).finalizePythonInterpreter()


def _loaded(library: str) -> ctypes.CDLL:
    """Return a library that is already loaded, and keep it loaded. Raises OSError if it is not."""
    return ctypes.CDLL(library, os.RTLD_NOW | os.RTLD_NOLOAD)
