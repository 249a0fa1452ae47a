"""The errors and warnings of the library, and how they name files and lines; importing them loads nothing else."""

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

NOT_THE_CALLER = ("rbfmu", "rbfmu_kernels", "rbfmu_fmu", "functools", "contextlib")
"""Packages whose lines are not the caller's: our own, and those that call our functions for us."""


class SceneError(ValueError):
    """The error of a wrong scene: `.faults` is the list of all that is wrong with it, one line each.

    `.source`: the file or the scene's name; `.code`: a key of `rbfmu_kernels.buffer.FAULTS` if a model refuses the
    start, else 0.
    """

    def __init__(self, faults: str | Iterable[str], source: str = "", code: int = 0) -> None:
        self.faults = [faults] if isinstance(faults, str) else list(faults)
        self.source, self.code = source, code
        super().__init__(self.faults, source)

    def __str__(self) -> str:
        prefix = f"{self.source}: " if self.source else ""
        return "\n".join(prefix + fault for fault in self.faults)


class SceneWarning(UserWarning):
    """The warning of a scene that is possible, but looks like a mistake."""


class SimulationError(RuntimeError):
    """The error of a refused step: the motion is no longer finite, or would take too many substeps."""


class PlanningWarning(RuntimeWarning):
    """The warning that making a plan takes long."""


def warn_caller(message: str, category: type[Warning]) -> None:
    """Give a warning at the line from which the library was called, however deep in the library its reason is."""
    level, frame = 1, sys._getframe()  # this function, which is level 1
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in NOT_THE_CALLER:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


def path_of(path: object, name: str = "path") -> Path:
    """Return a path. Raises TypeError for anything but text or a path, such as a number of runs."""
    if not isinstance(path, str | Path):
        raise TypeError(f"{f'{name} = {path!r}':.120}: expected a path")
    return Path(path)


@contextmanager
def named(path: str | Path | None) -> Iterator[None]:
    """Add the path that is written to an OSError that names no file, such as that of a full disk."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename is not None or path is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
