"""The progress bar, on terminals and in notebooks."""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from time import monotonic
from typing import Any

SOON, OFTEN = 1.0, 0.1
"""SOON: the time in s after which a bar appears on a terminal. OFTEN: the least time between its updates, s."""


def progress_bar(name: str) -> Callable[[Sequence[Any]], Any] | None:
    """Return a function that iterates over a sequence and shows a progress bar; None if nobody would see it.

    It is meant for the argument `progress` of `simulate`. On a terminal the bar appears after a second. A notebook
    needs ipywidgets for it (`pip install "rbfmu[notebook]"`).
    """
    return (lambda numbers: _with_bar(numbers, name)) if _is_seen() else None


def _with_bar(numbers: Sequence[Any], name: str) -> Iterator[Any]:
    with bar(name) as tell:
        for done, number in enumerate(numbers):
            tell(done, len(numbers))
            yield number


@contextmanager
def bar(name: str, shown: bool = True) -> Iterator[Callable[..., None]]:
    """Yield a function (done, total=1, text=name) that updates a progress bar.

    The bar disappears at the end, and is not shown where nobody would see it. It appears late and is seldom updated,
    so that most calls only read the clock: loading Rich takes as long as many runs.
    """
    if not (shown and _is_seen()):
        yield lambda done, total=1.0, text=name: None
        return
    with ExitStack() as stack:
        due, update = monotonic() + (SOON if _on_terminal() else 0.0), None

        def tell(done: float, total: float = 1.0, text: str = name) -> None:
            nonlocal due, update
            if monotonic() > due:
                update = update or stack.enter_context(_rich_bar())
                update(description=text, completed=done, total=total)
                due = monotonic() + OFTEN

        yield tell


@contextmanager
def _rich_bar() -> Iterator[Callable[..., None]]:
    from rich import console, progress

    # no automatic updates: Rich's thread would write to a notebook together with the cell, whose end may get lost
    with progress.Progress(console=console.Console(stderr=True), transient=True, auto_refresh=False) as shown:
        task = shown.add_task("")
        yield lambda **state: shown.update(task, refresh=True, **state)


def _is_seen() -> bool:
    """Return whether a bar would be seen: on a terminal, or in a notebook that has ipywidgets."""
    if _on_terminal() or "IPython" not in sys.modules:
        return _on_terminal()
    from rich.console import Console

    return Console(stderr=True).is_jupyter and find_spec("ipywidgets") is not None


def _on_terminal() -> bool:
    """Return whether stderr is a terminal that can redraw a line; in a graphical program it may be None, or its own."""
    try:
        return sys.stderr.isatty() and os.environ.get("TERM", "") not in ("dumb", "unknown")
    except (AttributeError, ValueError):
        return False
