"""The stamp of cached code, as Numba's own sees a function's file, but not those of the functions that it calls."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).parents[1]


def hash_of_sources(package: Path) -> str:
    """Return a hash of all modules below a folder."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


SOURCES = hash_of_sources(_PACKAGE)
"""The hash of this package's sources."""


def stamp_of(function: Callable[..., Any]) -> str:
    """Return the stamp of a function's code: the hash of all kernels, and of its own file where that is elsewhere."""
    file = Path(function.__code__.co_filename)
    return SOURCES if file.is_relative_to(_PACKAGE) else SOURCES + hashlib.sha256(file.read_bytes()).hexdigest()[:16]
