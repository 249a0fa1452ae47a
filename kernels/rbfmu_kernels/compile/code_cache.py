"""Compiled code on disk, stamped with a hash of all sources: Numba's own stamp ignores the files of called kernels."""

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
from . import codegen, numba_private as inside

try:
    import fcntl
except ImportError:  # Windows: each process compiles for itself
    fcntl = None  # type: ignore[assignment]

T = TypeVar("T")
_PACKAGE = Path(__file__).parents[1]


def hash_of_sources(package: Path) -> str:
    """Return a hash of all Python modules below a folder, 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


SOURCES = hash_of_sources(_PACKAGE)
"""The hash of this package's sources."""


def reached(function: Any) -> set[FunctionType]:
    """Return the function and those of all kernels that it calls, directly or indirectly."""
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
    """Return a copy of the template with other values of some globals; unlike a closure, it can be cached on disk."""
    function = FunctionType(template.__code__, {**template.__globals__, **names}, name)
    function.__qualname__ = "".join(c if c.isalnum() else "_" for c in name)
    return function


def stamp_of(function: Function) -> str:
    """Return the stamp of a function's code: the hash of this package, and one of other files whose code it uses."""
    if Path(function.__code__.co_filename).is_relative_to(_PACKAGE):
        return SOURCES
    files = sorted({Path(one.__code__.co_filename) for one in reached(function)})
    own = b"".join(file.read_bytes() for file in files if file.is_file() and not file.is_relative_to(_PACKAGE))
    return SOURCES + hashlib.sha256(own).hexdigest()[:16]


def kept_on_disk(compiled: Callable[[bool], T]) -> T:
    """Return compiled(True), with Numba's cache in a folder named by `SOURCES`; compiled(False) if none can be written.

    The folder's name is needed, as Numba's own stamp ignores the files of called kernels.
    """
    folder = config.CACHE_DIR
    config.CACHE_DIR = str(Path(folder or _PACKAGE / "__pycache__") / SOURCES)
    try:
        return compiled(True)
    except RuntimeError:  # no folder can be written
        return compiled(False)
    finally:
        config.CACHE_DIR = folder


GENERATED = "<formulas "
"""The beginning of the file name of generated code, whose module has a digest of the text in its name."""


def _in_a_file(function: Function) -> Function:
    """Return the function as Numba's cache accepts it: generated code gets this file, and its module in its name.

    Without a cache each process would compile it again for callers that are not cached yet, while cached callers
    contain an earlier copy: the bytes of an FMU's code would depend on which process compiled what.
    """
    code = function.__code__
    if not code.co_filename.startswith(GENERATED):
        return function
    return named(FunctionType(code.replace(co_filename=__file__), {}), f"{function.__module__}.{function.__name__}")


_CacheFile: Any = getattr(inside, "IndexDataCacheFile", object)  # where Numba has none, its own cache is used


class CheckedFile(_CacheFile):  # type: ignore[misc]
    """Numba's files of one function, with checksums at their ends: what is damaged counts as missing, and is replaced.

    Numba would not replace an index that is cut short, and would run damaged code. Its reader ignores what follows.
    """

    def _dump(self, content: object) -> bytes:
        data: bytes = super()._dump(content)
        return data + hashlib.sha256(data).digest()

    def _load_index(self) -> dict[Any, str]:
        try:
            found: dict[Any, str] = super()._load_index()
        except Exception:  # unpickling may raise any
            return {}
        return found

    def _load_data(self, name: str) -> Any:
        data = Path(self._data_path(name)).read_bytes()
        return super()._load_data(name) if data[-32:] == hashlib.sha256(data[:-32]).digest() else None


class DiskCache:
    """The cache of one function; it stays empty where no folder can be written or Numba's cache cannot be used.

    It is opened at the first use. Reading it does not load Numba's compiler, which would take 0.2 s.
    """

    def __init__(self, function: Function, kind: type | None = None) -> None:
        """kind: the class of the cache, `CalleeCache`, or None for Numba's own."""
        self._function, self._kind = function, kind

    def load_overload(self, signature: tuple[types.Type, ...], context: codegen.Context) -> "inside.CompileResult":
        """Return the stored code, or None if there is none."""
        try:
            if not os.path.exists(self._cache._cache_file._index_path):
                return None  # without the next line, which takes 25 ms the first time
            inside.rtsys.initialize(context)  # the object code refers to functions of Numba's runtime
            return self._cache._load_overload(signature, context)
        except Exception:  # Numba's internals differ from those of the versions tried
            return None

    def save_overload(self, signature: tuple[types.Type, ...], compiled: Any) -> None:
        """Store code; where that fails, as on a full disk or in files of another user, it serves this process alone."""
        with suppress(Exception):
            self._cache.save_overload(signature, compiled)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    @cached_property
    def _cache(self) -> "inside.FunctionCache":
        try:
            cache = (self._kind or inside.FunctionCache)(_in_a_file(self._function))
            name = cache._impl.filename_base + ("-callee" if self._kind else "")
            cache._cache_file = CheckedFile(cache._cache_path, name, stamp_of(self._function))
        except (RuntimeError, AttributeError, TypeError):
            return inside.NullCache()
        return cache


@contextmanager
def made_once(kept: "DiskCache") -> Iterator[None]:
    """Let one process at a time compile a cached function; the others wait, and then find its code in the cache.

    Where files cannot be locked, each process compiles. Numba's own lock, between threads, is taken first. In the other
    order, a thread with the file's lock would wait for Numba's lock, while the thread that has it, compiling a caller,
    would wait for the file's: a deadlock.
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
                    os.unlink(path)  # waiting processes still get the lock; later ones make a new file and find code
                os.close(handle)
