"""The stamp of cached code, as Numba's own sees a function's file, but not those of the functions that it calls."""

import hashlib
from pathlib import Path


def hash_of_sources(package: Path) -> str:
    """Return a hash of all modules below a folder."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


SOURCES = hash_of_sources(Path(__file__).parents[1])
"""The hash of this package's sources."""
