"""What rbfmu does without: packages that only an extra installs."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any


def remedy(extra: str) -> str:
    """Return the command that installs an extra."""
    return f'pip install "rbfmu[{extra}]"'


@contextmanager
def needed_of(extra: str) -> Iterator[None]:
    """End a program by one line that names the extra, where an import inside finds no module (SystemExit)."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise SystemExit(f"{error.name} is not installed: {remedy(extra)}") from None


def needed(package: str, extra: str) -> Any:
    """Return a package of an extra. Raises ModuleNotFoundError with the command that installs it."""
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"{error.name} is not installed: {remedy(extra)}", name=error.name) from None
