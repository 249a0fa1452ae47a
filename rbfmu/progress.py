"""Bars of progress, on terminals and in notebooks."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from time import monotonic
from typing import Any

SOON, OFTEN = 1.0, 0.1
"""The times, s, after which a bar comes, and after which it moves."""


def progress_bar(name: str) -> Callable[[Sequence[Any]], Any] | None:
    """Return what wraps a sequence in a bar, on a terminal after a second; None where nobody would see it.

    For `progress` of `simulate`. A notebook needs ipywidgets for it (`pip install "rbfmu[notebook]"`).
    """
    return (lambda numbers: _bar_when_long(numbers, name)) if _is_seen() else None


def _bar_when_long(numbers: Sequence[Any], name: str) -> Iterator[Any]:
    with ExitStack() as stack:
        due, bar = monotonic() + (SOON if sys.stderr.isatty() else 0.0), None
        for done, number in enumerate(numbers):
            if monotonic() > due:
                bar = bar or stack.enter_context(_bar(name, len(numbers)))
                bar(done)
                due = monotonic() + OFTEN
            yield number


@contextmanager
def _bar(name: str, total: int) -> Iterator[Callable[[int], Any]]:
    """Show a bar; yield what tells it how many are done. Rich is loaded here: that takes as long as many a run."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=total)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def members_bar(name: str, done: int, total: int, shown: bool = True) -> Iterator[Callable[[int], Any]]:
    """Show how many of a total are done, how many a second, and the time left; yield what counts on.

    It goes when done, and is not there where nobody would see it. done: how many are at the start.
    """
    if not (shown and _is_seen()):
        yield lambda count: None
        return
    from rich import progress as bars
    from rich.console import Console

    columns = (bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn(),
               bars.TextColumn("{task.fields[rate]}"), bars.TimeRemainingColumn())  # fmt: skip
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=total, completed=done, rate="")

        def advance(count: int) -> None:
            bar.advance(task, count)
            speed = bar.tasks[0].speed
            bar.update(task, rate=f"{speed:,.0f} runs/s" if speed else "")

        yield advance


def _is_seen() -> bool:
    """Return whether somebody sees a bar: on a terminal, or in a notebook that has ipywidgets."""
    if sys.stderr.isatty() or "IPython" not in sys.modules:
        return sys.stderr.isatty()
    from rich.console import Console

    return Console(stderr=True).is_jupyter and find_spec("ipywidgets") is not None
