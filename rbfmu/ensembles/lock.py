"""A lock on a store, which lets one program at a time write to it."""

import errno
import importlib
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:
    fcntl = None  # type: ignore[assignment]
try:
    msvcrt = importlib.import_module("msvcrt")  # Windows; a type checker knows it nowhere else
except ImportError:
    msvcrt = None  # type: ignore[assignment]

FAR = 1 << 30
"""The byte that is locked on Windows: others cannot read a locked byte, and the first bytes say who holds the file."""
_HERE: dict[str, object] = {}
"""The stores that this process writes to: the lock of a file belongs to a process, not to a thread."""


@contextmanager
def store_lock(store: Path) -> Iterator[None]:
    """Lock a store, or the target of a link, by a file beside it. Raises BlockingIOError that names the holder.

    The lock ends with its process, however that ends; forked processes do not have it. Where files cannot be locked,
    nothing is locked.
    """
    key, mine = os.path.realpath(store), object()
    beside = Path(f"{key}.lock")
    if _HERE.setdefault(key, mine) is not mine:
        raise _refusal(store, _me())
    try:
        handle = _lock_file(store, beside) if fcntl or msvcrt else None
        try:
            yield
        finally:
            if handle is not None:
                _remove(beside, handle)
    finally:
        del _HERE[key]


def _lock_file(store: Path, beside: Path) -> int | None:
    """Return the descriptor of the locked file, which says who we are; None where files cannot be locked."""
    while True:
        try:
            handle = os.open(beside, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError:
            return None
        try:
            _try_lock(handle)
            if fcntl is None or os.path.samestat(os.fstat(handle), os.stat(beside)):
                os.ftruncate(handle, 0)
                os.write(handle, _me().encode())
                return handle
        except FileNotFoundError:  # the last holder has just removed it
            pass
        except OSError as error:
            holder = os.read(handle, 200).decode(errors="replace")
            os.close(handle)
            if error.errno in (errno.EACCES, errno.EAGAIN):
                raise _refusal(store, holder or "another process") from None
            return None
        os.close(handle)


def _try_lock(handle: int) -> None:
    """Lock an open file. Raises OSError where another process holds it."""
    if fcntl:
        fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return
    try:
        os.lseek(handle, FAR, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
    finally:
        os.lseek(handle, 0, os.SEEK_SET)


def _remove(beside: Path, handle: int) -> None:
    """Remove a locked file: on POSIX before others can lock it, on Windows after closing it, unless others hold it."""
    if fcntl is None:
        os.close(handle)
    with suppress(OSError):
        beside.unlink()
    if fcntl:
        os.close(handle)


def _me() -> str:
    return f"process {os.getpid()} on {platform.node()}"


def _refusal(store: Path, holder: str) -> OSError:
    return BlockingIOError(errno.EAGAIN, f"is being written by {holder}: expected one program at a time", str(store))
