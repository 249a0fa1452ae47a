"""Files kept on disk, such as the plans of scene files, which need planning only once; and files that replace others.

A plan is identified by the bytes and the path of its scene file, the options, and the sources and versions with which
it was made. If nothing can be written, or a checksum shows that a file has changed, the scene is planned again.
"""

import errno
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from glob import escape
from importlib.util import find_spec
from pathlib import Path
from secrets import token_hex
from typing import IO, Any

MOST = 200
"""The largest number of plans that are kept; the oldest are deleted."""
PACKAGES = ("rbfmu", "rbfmu_kernels", "rbfmu_fmu")
VERSIONS = {"numba": "_version.py", "numpy": "version.py"}
"""The modules with the versions, which are read as files: `importlib.metadata` takes a hundred times as long."""


def kept_plan(scene: Path, options: Mapping[str, object], make: Callable[[], Mapping[str, object]]) -> dict[str, Any]:
    """Return what a command keeps about a scene file's plan; if nothing is kept, make it now and keep it.

    Nothing is kept for a pipe: it can be read only once, and all pipes would look alike, namely empty.
    """
    if not os.path.isfile(scene):
        return dict(make())
    file = None
    with suppress(OSError):
        digest = hashlib.sha256(_stamp())
        digest.update(json.dumps([str(scene), dict(options)], sort_keys=True).encode())
        digest.update(scene.read_bytes())
        file = folder("rbfmu_plans", os.environ.get("NUMBA_CACHE_DIR")) / f"{digest.hexdigest()}.json"
    return dict(json.loads(kept(file, lambda: json.dumps(make()).encode(), MOST)))


def kept(file: Path | None, make: Callable[[], bytes], most: int) -> bytes:
    """Return the content of a file; if there is none, or its checksum is wrong, make the content now and write it.

    file: None to make the content without keeping it. If its folder then has more than `most` files with its suffix,
    the oldest are deleted.
    """
    if file is None:
        return make()
    with suppress(OSError):
        checksum, _, content = file.read_bytes().partition(b"\n")
        if checksum == _checksum(file, content):
            return content
    content = make()
    with suppress(OSError):  # the folder cannot be written, or another process reads the file on Windows
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, _checksum(file, content) + b"\n" + content)
        for old in sorted(file.parent.glob(f"*{file.suffix}"), key=lambda path: path.stat().st_mtime)[:-most]:
            old.unlink()
    return content


def write_whole(file: Path, content: bytes) -> None:
    """Write a whole file, as `replacing` does."""
    with replacing(file) as part:
        part.write(content)


@contextmanager
def replacing(path: Path, mode: str = "wb", **text: Any) -> Iterator[IO[Any]]:
    """Yield a file that, when it is completely written, replaces the file at this path, or the one that a link names.

    The new file has the permissions of the old one, and its owner where that is allowed. A file that may not be written
    raises PermissionError, as with `open`. A pipe or a device is not replaced, but written to. text: further arguments
    of `open`, such as encoding.
    """
    there = path.exists()
    target = Path(os.path.realpath(path))  # `resolve` raises another error if links form a loop
    part = target.with_name(f"{target.name}.{token_hex(4)}.part")
    try:
        if there and not path.is_file():
            with path.open(mode, **text) as pipe:
                yield pipe
            return
        if there and not os.access(target, os.W_OK):  # in a writable folder, even a protected file can be replaced
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        try:
            with part.open(mode.replace("w", "x"), **text) as file:
                yield file
            if there:
                old = target.stat()
                with suppress(OSError, AttributeError):  # who is not root may not; nor does Windows have it
                    os.chown(part, old.st_uid, old.st_gid)
                part.chmod(old.st_mode & 0o777)
            part.replace(target)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    except OSError as error:
        error.filename = str(path)  # the error of a full disk names no file, other errors name the temporary one
        raise


def remove_parts(path: Path) -> None:
    """Remove what killed programs left half written for this path; no other program may be writing to it now."""
    target = Path(os.path.realpath(path))
    for part in target.parent.glob(f"{escape(target.name)}.*.part"):
        with suppress(OSError):  # it is another user's
            part.unlink()


def try_replacing(path: Path) -> None:
    """Raise the OSError that `replacing` would raise, before the content is made, which may take long."""
    if path.is_file() or not path.exists():  # opening a pipe would wait for a reader
        with suppress(_TriedError), replacing(path):
            raise _TriedError


class _TriedError(Exception):
    pass


def _checksum(file: Path, content: bytes) -> bytes:
    """Return a checksum of the content and of the file's name."""
    return hashlib.sha256(file.stem.encode() + b"\n" + content).hexdigest().encode()


def folder(name: str, given: str | None) -> Path:
    """Return the folder of this name, beside Numba's compiled code in the folder that is given, if it is.

    By default it is in the package or, where that may not be written, in the user's folder of such files.
    """
    beside = Path(__file__).parent / "__pycache__"
    if not given and not os.access(beside if beside.exists() else beside.parent, os.W_OK):
        with suppress(RuntimeError):  # there is no home
            return Path.home() / ".cache" / "rbfmu" / name
    return Path(given or beside) / name


def _stamp() -> bytes:
    """Return bytes that identify the present sources and library versions; nothing is imported for this."""
    sources = [path for package in PACKAGES for path in sorted(_modules(package, "**/*.py"))]
    lines = [f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}" for path in sources]
    versions = [file.read_bytes() for name, file_name in VERSIONS.items() for file in _modules(name, file_name)]
    return b"".join([*versions, "\n".join(lines).encode()])


def _modules(package: str, pattern: str) -> Iterator[Path]:
    spec = find_spec(package)
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        yield from Path(folder).glob(pattern)
