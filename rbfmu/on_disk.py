"""What is kept on disk, such as plans of scene files, which are so planned once; files written whole; a store's lock.

A plan is known by the bytes of its scene file, the options, and the sources and versions that it was made with. Where
nothing can be written, or what stands there is not what was written (a checksum says so), the scene is planned anew.
"""

import errno
import hashlib
import importlib
import json
import os
import platform
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:
    fcntl = None  # type: ignore[assignment]
try:
    msvcrt: Any = importlib.import_module("msvcrt")  # Windows; a type checker knows it nowhere else
except ImportError:
    msvcrt = None

MOST = 200
"""The number of plans that are kept; the oldest go."""
PACKAGES = ("rbfmu", "rbfmu_kernels", "rbfmu_fmu")
VERSIONS = {"numba": "_version.py", "numpy": "version.py"}
"""The modules that say their versions: read as files in a hundredth of the time that `importlib.metadata` takes."""


def kept_plan(scene: Path, options: Mapping[str, object], make: Callable[[], Mapping[str, object]]) -> dict[str, Any]:
    """Return what is known of a scene file's plan: what was kept, or what is made now and kept."""
    file = None
    with suppress(OSError):
        digest = hashlib.sha256(_stamp())
        digest.update(json.dumps([str(scene), dict(options)], sort_keys=True).encode())
        digest.update(scene.read_bytes())
        file = _folder() / f"{digest.hexdigest()}.json"
    known: dict[str, Any] = json.loads(kept(file, lambda: json.dumps(make()).encode(), MOST))
    return known


def kept(file: Path | None, make: Callable[[], bytes], most: int) -> bytes:
    """Return what a file keeps or, where there is none or it is not what was written there, what is made now and kept.

    The oldest of its kind in its folder go beyond `most`.
    """
    if file is None:
        return make()
    with suppress(OSError):
        checksum, _, content = file.read_bytes().partition(b"\n")
        if checksum == _checksum(file, content):
            return content
    content = make()
    with suppress(OSError):  # of a folder that cannot be written; on Windows, where another process reads the file
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, _checksum(file, content) + b"\n" + content)
        for old in sorted(file.parent.glob(f"*{file.suffix}"), key=lambda path: path.stat().st_mtime)[:-most]:
            old.unlink()
    return content


def write_whole(file: Path, content: bytes) -> None:
    """Write a file, whole or not at all: what stands there is replaced when all is written."""
    handle, temporary = tempfile.mkstemp(prefix=file.name, suffix=".part", dir=file.parent)
    try:
        with os.fdopen(handle, "wb") as part:
            part.write(content)
        os.chmod(temporary, 0o644)
        os.replace(temporary, file)
    except BaseException as error:
        os.unlink(temporary)
        if isinstance(error, OSError):
            error.filename = str(file)  # else a full disk names no file
        raise


def _checksum(file: Path, content: bytes) -> bytes:
    """Return what tells this content from others, and its place from that of another file."""
    return hashlib.sha256(file.stem.encode() + b"\n" + content).hexdigest().encode()


def _folder() -> Path:
    """Return a folder beside Numba's compiled code."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    return (Path(given) if given else Path(__file__).parent / "__pycache__") / "rbfmu_plans"


def _stamp() -> bytes:
    """Return what tells these sources and libraries from others; nothing is loaded for it."""
    sources = [path for package in PACKAGES for path in sorted(_modules(package, "**/*.py"))]
    lines = [f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}" for path in sources]
    versions = [file.read_bytes() for name, file_name in VERSIONS.items() for file in _modules(name, file_name)]
    return b"".join([*versions, "\n".join(lines).encode()])


def _modules(package: str, pattern: str) -> Iterator[Path]:
    spec = find_spec(package)
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        yield from Path(folder).glob(pattern)


# A lock on a store, which lets one program at a time write to it

FAR = 1 << 30
"""The byte that is locked on Windows: nobody else can read one that is, and the first ones say who holds the file."""
_HERE: dict[str, object] = {}
"""The stores that this process writes to: the lock of a file is that of a process, not of a thread."""


@contextmanager
def store_lock(store: Path) -> Iterator[None]:
    """Hold a store, by a lock on a file beside it; raise BlockingIOError that names who holds it.

    The lock ends with its process, however that ends, and is not that of processes forked from it. Where files cannot
    be locked nothing is held.
    """
    key, mine, beside = str(store.resolve()), object(), store.with_name(f"{store.name}.lock")
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
        except FileNotFoundError:  # who held it has just removed it
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
    """Remove a locked file: on POSIX before others can lock it, on Windows once it is closed, unless others have it."""
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
