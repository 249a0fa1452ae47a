"""What rbfmu does without: packages that only an extra installs."""

from collections.abc import Iterator
from contextlib import contextmanager


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
