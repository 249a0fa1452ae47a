"""Laws: what a kernel computes in exact arithmetic, on which arguments, and how far off it was measured to be."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from tests.support.references import exact
from tests.support.references.worst_cases import WORST


@dataclass(frozen=True)
class Law:
    """`kernel(*case)` is `truth(*case)` within `bound` eps of `scale(*case)`, for every case and the worst known."""

    kernel: Callable[..., Any]
    truth: Callable[..., Any]
    cases: Callable[[], Sequence[tuple[Any, ...]]]
    bound: float
    scale: Callable[..., Any] = lambda *case: 1
    measure: Callable[[Any, Any, Any], float] = exact.error

    @property
    def name(self) -> str:
        return getattr(self.kernel, "py_func", self.kernel).__name__

    @cache  # noqa: B019
    def worst(self) -> tuple[float, tuple[Any, ...]]:
        """The largest error in eps, and its case."""
        worst, where = -1.0, ()
        for case in [*self.cases(), *([WORST[self.name]] if self.name in WORST else [])]:
            numbers = exact.exact(case)
            error = self.measure(self.kernel(*case), self.truth(*numbers), self.scale(*numbers))
            assert error == error, f"{self.name}{case} is not a number"
            if error > worst:
                worst, where = error, case
        return worst, where

    def check(self) -> None:
        """Fails above the bound, far below it (then it has to follow), and where the docstring states another one."""
        worst, where = self.worst()
        assert worst <= self.bound, f"{self.name}{where} is off by {worst:.2f} eps"
        assert worst >= self.bound / 3.0, f"{self.name} is better than stated: {worst:.2f} eps"
        stated = f"Error <= {self.bound:g} " if self.bound else "Exact"
        assert stated in (self.kernel.__doc__ or ""), f"the docstring of {self.name} does not say {stated!r}"


def up_to_sign(value: Any, truth: Any, scale: Any) -> float:
    """q and -q are one rotation; u and -u one half turn."""
    return min(exact.error(value, truth, scale), exact.error(value, [-t for t in exact.flat(truth)], scale))


def norm_of_second(_: Any, v: Any, *rest: Any) -> Any:
    """The scale of what turns the second argument."""
    return exact.norm(v)


def length(v: Any) -> Any:
    """The scale of a vector that may be zero."""
    return exact.norm(v) or 1
