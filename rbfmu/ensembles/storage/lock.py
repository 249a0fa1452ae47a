"""One program at a time writes to a store: the second is told who does."""

import errno
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: a store is not locked there
    fcntl = None  # type: ignore[assignment]

_HERE: dict[str, object] = {}
"""The stores that this process writes to: the lock of a file is that of a process, not of a thread."""


@contextmanager
def held(store: Path) -> Iterator[None]:
    """Hold a store, by a lock on a file beside it; raise BlockingIOError that names who holds it.

    The lock ends with its process, however that ends, and is not that of processes forked from it. Where files cannot
    be locked nothing is held.
    """
    key, mine, beside = str(store.resolve()), object(), store.with_name(f"{store.name}.lock")
    if _HERE.setdefault(key, mine) is not mine:
        raise _refusal(store, _me())
    try:
        handle = _locked(store, beside) if fcntl else None
        try:
            yield
        finally:
            if handle is not None:
                with suppress(OSError):
                    beside.unlink()
                os.close(handle)
    finally:
        del _HERE[key]


def _locked(store: Path, beside: Path) -> int | None:
    """Return the descriptor of the locked file, which says who we are; None where files cannot be locked."""
    while True:
        try:
            handle = os.open(beside, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError:
            return None
        try:
            fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(handle), os.stat(beside)):
                os.ftruncate(handle, 0)
                os.write(handle, _me().encode())
                return handle
        except FileNotFoundError:  # who held it has just removed it
            pass
        except OSError as error:
            holder = os.read(handle, 200).decode(errors="replace")
            os.close(handle)
            if error.errno in (errno.EACCES, errno.EAGAIN):
                raise _refusal(store, holder or "another process") from None
            return None
        os.close(handle)


def _me() -> str:
    return f"process {os.getpid()} on {platform.node()}"


def _refusal(store: Path, holder: str) -> OSError:
    return BlockingIOError(errno.EAGAIN, f"is being written by {holder}: expected one program at a time", str(store))
