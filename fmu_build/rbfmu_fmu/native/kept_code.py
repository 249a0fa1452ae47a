"""Object code of models, kept on disk beside Numba's compiled code: a model is compiled for a platform once.

It is known by all that it is made with: sources, versions, model, platform. A file begins with the hash of the rest, by
which a damaged one is found. Where nothing can be written or read, the model is compiled anew.
"""

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import llvmlite
import numba
from llvmlite.binding import get_process_triple

from rbfmu_kernels.compile.stamp import SOURCES

MOST = 100
"""The number of object files that are kept, some 100 kB each; the oldest go."""
COMPILER = Path(__file__).with_name("object_code.py")
"""The source of what compiles, besides the kernels."""


def kept(what: str, compiled: Callable[[], bytes]) -> bytes:
    """Return object code from disk, or compile and keep it; what: the model and the platform."""
    file = _folder() / f"{_digest(_made_with() + what.encode()).hex()}.o"
    with suppress(OSError):
        content = file.read_bytes()
        if _digest(content[32:]) == content[:32]:
            return content[32:]
    code = compiled()
    with suppress(OSError):
        _write(file, _digest(code) + code)
    return code


def _write(file: Path, content: bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=file.parent, suffix=".part")
    with os.fdopen(handle, "wb") as part:
        part.write(content)
    os.replace(temporary, file)
    for old in sorted(file.parent.glob("*.o"), key=lambda path: path.stat().st_mtime)[:-MOST]:
        old.unlink()


def _folder() -> Path:
    return Path(numba.config.CACHE_DIR or Path(__file__).parent / "__pycache__") / "rbfmu_objects"


def _made_with() -> bytes:
    """Return the sources and versions that object code is made with."""
    versions = [numba.__version__, llvmlite.__version__, sys.version, get_process_triple()]
    return "\n".join([SOURCES, *versions, COMPILER.read_text(encoding="utf-8")]).encode()


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()
