"""Bars of progress, on terminals and in notebooks."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any


def progress_bar(name: str) -> Callable[[Sequence[Any]], Any] | None:
    """Return what wraps a sequence in a bar that goes when done; None where nobody would see it.

    For `progress` of `simulate`. A notebook needs ipywidgets for it (`pip install "rbfmu[notebook]"`).
    """
    from rich.progress import track

    console = _seen_console()
    return None if console is None else lambda numbers: track(numbers, name, console=console, transient=True)


@contextmanager
def members_bar(name: str, done: int, total: int, shown: bool = True) -> Iterator[Callable[[int], Any]]:
    """Show how many of a total are done, how many a second, and the time left; yield what counts on.

    It goes when done, and is not there where nobody would see it. done: how many are at the start.
    """
    console = _seen_console() if shown else None
    if console is None:
        yield lambda count: None
        return
    from rich import progress as bars

    columns = (bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn(),
               bars.TextColumn("{task.fields[rate]}"), bars.TimeRemainingColumn())  # fmt: skip
    with bars.Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(name, total=total, completed=done, rate="")

        def advance(count: int) -> None:
            bar.advance(task, count)
            speed = bar.tasks[0].speed
            bar.update(task, rate=f"{speed:,.0f} runs/s" if speed else "")

        yield advance


def _seen_console() -> Any:
    """Return a console that somebody sees, or None."""
    from rich.console import Console

    console = Console(stderr=True)
    unseen = find_spec("ipywidgets") is None if console.is_jupyter else not sys.stderr.isatty()
    return None if unseen else console
