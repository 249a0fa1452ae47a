"""Compiled code on disk, with a stamp of all sources, as Numba's own sees a function's file but not what it calls."""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar

from numba import config, types

from ..types import Function
from . import numba_private as inside
from .codegen import Context

try:
    import fcntl
except ImportError:  # Windows: each process compiles for itself
    fcntl = None  # type: ignore[assignment]

T = TypeVar("T")
_PACKAGE = Path(__file__).parents[1]


def hash_of_sources(package: Path) -> str:
    """Return a hash of all modules below a folder."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


SOURCES = hash_of_sources(_PACKAGE)
"""The hash of this package's sources."""


def reached(function: Any) -> set[FunctionType]:
    """Return a function and those of all kernels that it calls, at any depth."""
    found, waiting = set[FunctionType](), [function]
    while waiting:
        one = waiting.pop()
        if one in found:
            continue
        found.add(one)
        known, names = one.__globals__, one.__code__.co_names
        used = [known[name] for name in names if name in known]
        used += [cell.cell_contents for cell in one.__closure__ or ()]
        used += [getattr(module, name, None) for module in used if isinstance(module, ModuleType) for name in names]
        waiting += [kernel.py_func for kernel in used if hasattr(kernel, "py_func")]
    return found


def named(template: Function, name: str, **names: object) -> Function:
    """Return a function in which names stand for others: its code can be kept, where that of a closure cannot."""
    function = FunctionType(template.__code__, {**template.__globals__, **names}, name)
    function.__qualname__ = "".join(c if c.isalnum() else "_" for c in name)
    return function


def stamp_of(function: Function) -> str:
    """Return the stamp of a function's code: the hash of all kernels, and of the files of what else it calls."""
    if Path(function.__code__.co_filename).is_relative_to(_PACKAGE):
        return SOURCES
    files = sorted({Path(one.__code__.co_filename) for one in reached(function)})
    own = b"".join(file.read_bytes() for file in files if file.is_file() and not file.is_relative_to(_PACKAGE))
    return SOURCES + hashlib.sha256(own).hexdigest()[:16]


def kept_on_disk(compiled: Callable[[bool], T]) -> T:
    """Compile with a cache in a folder of these sources, as Numba's stamp does not see what a function calls."""
    folder = config.CACHE_DIR
    config.CACHE_DIR = str(Path(folder or _PACKAGE / "__pycache__") / SOURCES)
    try:
        return compiled(True)
    except RuntimeError:  # no folder can be written
        return compiled(False)
    finally:
        config.CACHE_DIR = folder


GENERATED = "<formulas "
"""How the file of a text that was generated begins, whose module has a digest of the text in its name."""


def _in_a_file(function: Function) -> Function:
    """Return a function as Numba's cache takes it: one of a generated text stands in this file, by its module's name.

    If it were not kept, each process would compile it anew for callers that are not kept yet, beside what is merged
    into those that are: an FMU's code would hang on which process compiled what.
    """
    code = function.__code__
    if not code.co_filename.startswith(GENERATED):
        return function
    return named(FunctionType(code.replace(co_filename=__file__), {}), f"{function.__module__}.{function.__name__}")


class DiskCache:
    """The cache of one function; none where no folder for it can be written, or where Numba's cannot be used.

    It is looked for at the first use, and read without loading Numba's compiler, which costs 0.2 s and is not needed.
    """

    def __init__(self, function: Function, kind: type | None = None) -> None:
        """kind: CalleeCache; without, it is Numba's own."""
        self._function, self._kind = function, kind

    def load_overload(self, signature: tuple[types.Type, ...], context: Context) -> "inside.CompileResult":
        """Return stored code, or None where there is none."""
        try:
            if not os.path.exists(self._cache._cache_file._index_path):
                return None  # before what follows, which takes 25 ms the first time
            inside.rtsys.initialize(context)  # object code names its functions, and must find all that it names
            return self._cache._load_overload(signature, context)
        except Exception:  # Numba's internals behave otherwise than where they were tried
            return None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    @cached_property
    def _cache(self) -> "inside.FunctionCache":
        try:
            cache = (self._kind or inside.FunctionCache)(_in_a_file(self._function))
            name = cache._impl.filename_base + ("-callee" if self._kind else "")
            cache._cache_file = inside.IndexDataCacheFile(cache._cache_path, name, stamp_of(self._function))
        except (RuntimeError, AttributeError, TypeError):
            return inside.NullCache()
        return cache


@contextmanager
def made_once(kept: "DiskCache") -> Iterator[None]:
    """Let one process at a time compile what a cache keeps, so that those which wait find what the first has made.

    Where files cannot be locked, each compiles. Threads wait at Numba's own lock, which comes first: one that had the
    file's lock and waited for Numba's would be waited for by the one that has Numba's and compiles a caller.
    """
    with inside.global_compiler_lock:
        handle, path = None, ""
        with suppress(OSError, AttributeError):  # the latter also without fcntl: then no file is left behind
            locked = fcntl.flock
            path = f"{kept._cache_file._index_path}.lock"
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            locked(handle, fcntl.LOCK_EX)
        try:
            yield
        finally:
            if handle is not None:
                with suppress(OSError):
                    os.unlink(path)  # who waits gets the lock still; who comes now makes a new file, and finds code
                os.close(handle)
