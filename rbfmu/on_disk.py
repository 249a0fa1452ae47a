"""What is kept on disk, such as plans of scene files, which are so planned once; and files written whole.

A plan is known by the bytes of its scene file, the options, and the sources and versions that it was made with. Where
nothing can be written, or what stands there is not what was written (a checksum says so), the scene is planned anew.
"""

import errno
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from secrets import token_hex
from typing import IO, Any

MOST = 200
"""The number of plans that are kept; the oldest go."""
PACKAGES = ("rbfmu", "rbfmu_kernels", "rbfmu_fmu")
VERSIONS = {"numba": "_version.py", "numpy": "version.py"}
"""The modules that say their versions: read as files in a hundredth of the time that `importlib.metadata` takes."""


def kept_plan(scene: Path, options: Mapping[str, object], make: Callable[[], Mapping[str, object]]) -> dict[str, Any]:
    """Return what is known of a scene file's plan: what was kept, or what is made now and kept.

    A plan of what is no file, such as a pipe, is not kept: it can be read once, and then looks empty, as all others do.
    """
    if not os.path.isfile(scene):
        return dict(make())
    file = None
    with suppress(OSError):
        digest = hashlib.sha256(_stamp())
        digest.update(json.dumps([str(scene), dict(options)], sort_keys=True).encode())
        digest.update(scene.read_bytes())
        file = _folder() / f"{digest.hexdigest()}.json"
    return dict(json.loads(kept(file, lambda: json.dumps(make()).encode(), MOST)))


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
    """Write a file as `replacing` does."""
    with replacing(file) as part:
        part.write(content)


@contextmanager
def replacing(path: Path, mode: str = "wb", **text: Any) -> Iterator[IO[Any]]:
    """Yield a file that, once it is written whole, replaces what stands there or where a link leads, with its mode.

    A file that may not be written is refused, as `open` does. What is no file, such as a pipe, stays where it is, and
    is written to. text: how text is, as `open` takes it.
    """
    there = path.exists()
    target = Path(os.path.realpath(path))  # `resolve` raises an error of its own where links go round
    part = target.with_name(f"{target.name}.{token_hex(4)}.part")
    try:
        if there and not path.is_file():
            with path.open(mode, **text) as pipe:
                yield pipe
            return
        if there and not os.access(target, os.W_OK):  # a folder lets any file be replaced, also a protected one
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        try:
            with part.open(mode.replace("w", "x"), **text) as file:
                yield file
            if there:
                part.chmod(target.stat().st_mode & 0o777)
            part.replace(target)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    except OSError as error:
        error.filename = str(path)  # a full disk names no file, others the part
        raise


def try_replacing(path: Path) -> None:
    """Raise OSError where `replacing` would: before there is anything to write, which may take long to make."""
    if path.is_file() or not path.exists():  # who opens a pipe waits for a reader
        with suppress(_TriedError), replacing(path):
            raise _TriedError


class _TriedError(Exception):
    pass


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
