"""Bars of progress, on terminals and in notebooks."""

import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any


def progress_bar(name: str) -> Callable[[Sequence[Any]], Any] | None:
    """Return what wraps a sequence in a bar that goes when done; None where nobody would see it.

    For `progress` of `simulate`. A notebook needs ipywidgets for it (`pip install "rbfmu[notebook]"`).
    """
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    if find_spec("ipywidgets") is None if console.is_jupyter else not sys.stderr.isatty():
        return None
    return lambda numbers: track(numbers, name, console=console, transient=True)
