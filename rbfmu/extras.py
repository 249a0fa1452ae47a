"""Packages that only an extra installs, and that rbfmu can do without."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any


def remedy(extra: str) -> str:
    """Return the command that installs an extra."""
    return f'pip install "rbfmu[{extra}]"'


@contextmanager
def needed_of(extra: str) -> Iterator[None]:
    """Raise SystemExit with one line that names the extra, if an import inside finds no module."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise SystemExit(f"{error.name} is not installed: {remedy(extra)}") from None


def needed(package: str, extra: str) -> Any:
    """Import and return a package of an extra. Raises ModuleNotFoundError with the command that installs it."""
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"{error.name} is not installed: {remedy(extra)}", name=error.name) from None


def version_of(package: str) -> str:
    """Return the version of a package that is installed; empty if none is."""
    from importlib.metadata import PackageNotFoundError, version  # only if needed, as it loads slowly

    try:
        return version(package)
    except PackageNotFoundError:
        return ""
