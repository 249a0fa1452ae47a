"""A chart: its measurements, and its table of at most 80 columns.

It has all measurements on a case, the smallest error of each method, and the models that are too small. From these it
computes what an accuracy costs by each kind of method.
"""

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rbfmu import exceptions, on_disk
from rbfmu.studies import WIDTH, cost_text, join_parts, short_number, tables_of, times, wrap_lines, write_rows
from rbfmu.studies.chart.cases import FLOOR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TAKES_NO = "takes no"
"""The start of the reason why a model cannot be used for a scene with ports, or with parameters that may change."""
STOPPED = "stopped: time limit"
YOURS = "your method"
_TABLES = tables_of("chart/kinds.toml")
OWN_KINDS: Mapping[str, str] = _TABLES["own"]
"""The library's own kinds of methods, each with the colour of its line."""
KINDS: Mapping[str, str] = _TABLES["own"] | _TABLES["others"]
"""All kinds of methods, each with the colour of its line."""
SIDES: Mapping[str, list[str]] = _TABLES["sides"]
"""The families of methods by who offers them: the library, its plans, common integrators, peers."""

_KIND = "{:22}{:29.28}{:>9}{:>9}{:>10}"
_DIGIT = "{:10}{:41.40}{:>9}{:>9}{:>10}"
_MODEL = "{:30}{:>10}{:>14}"


def kind_of(method: str, family: str) -> str:
    """Return the kind of a method, which is in a family."""
    if family != "peer":
        return str(_TABLES["families"].get(family, family))
    if method.startswith("SciPy") and method != "SciPy odeint":
        return "SciPy solve_ivp"
    return next(name for name in KINDS if method.startswith(name))


@dataclass(frozen=True)
class Row:
    """One method at one setting, or a plan at the accuracy that it was made for.

    detail: the method that a plan chose; error: as the scene's accuracy counts it; seconds: the processor time for a
    simulated second, s; run_seconds: that for the whole run, s; spread: the ratio of the least times in two halves of
    the repeats; right_hand_sides: evaluations in a run (0: none, NaN: not counted); compiling: the additional time of
    the method's first call, s; the drifts: relative, of what the motion conserves (NaN: it does not conserve it).
    """

    kind: str
    method: str
    detail: str
    family: str
    setting: str
    value: float
    error: float
    seconds: float
    run_seconds: float
    spread: float
    right_hand_sides: float
    compiling: float = 0.0
    energy_drift: float = math.nan
    momentum_drift: float = math.nan
    vertical_momentum_drift: float = math.nan


class End(NamedTuple):
    """The smallest error that a method reached (infinite: none below 1), and why no finer setting was tried."""

    kind: str
    method: str
    error: float
    why: str

    @property
    def stopped(self) -> bool:
        """Return whether the time limit stopped the method."""
        return self.why == STOPPED

    @property
    def never_ran(self) -> bool:
        """Return whether the method could not run at any setting."""
        return math.isinf(self.error) and self.why.startswith("not run")


class TooSmall(NamedTuple):
    """A model that is smaller than the plan's, and its error as the scene's accuracy counts it.

    why: why the model cannot be used, if there is a reason besides its error.
    """

    model: str
    error: float
    why: str = ""


@dataclass(frozen=True, repr=False)
class Chart:
    """Accuracy against cost on a scene; `print` shows a table, `save` writes table, CSV file and picture.

    model: the plan's; accuracy: the one asked; span: the length of the charted run, s; outputs: the number of its
    outputs; ports: the scene's ports, which nothing drives; held: their values, in words; rows: all measurements; ends:
    the smallest error of each method; too_small: smaller models than the plan's; absent: lines about peers that are not
    charted; refusal: why no tighter plan is made; machine: lines about what it was measured on; whole: the length of
    the scene's run, s (0: `span`); key: which of the eight motions it is, if one; many: whether outputs are many.
    """

    scene: str
    model: str
    accuracy: float
    span: float
    outputs: int
    ports: tuple[str, ...]
    rows: tuple[Row, ...]
    ends: tuple[End, ...]
    too_small: tuple[TooSmall, ...]
    absent: tuple[str, ...]
    refusal: str
    machine: tuple[str, ...]
    whole: float = 0.0
    key: str = ""
    many: bool = False
    held: str = "at zero"

    @property
    def plans(self) -> tuple[Row, ...]:
        """Return the plans: first the one for the accuracy asked, then those for each further digit."""
        return tuple(row for row in self.rows if row.family == "planned" and row.value <= self.accuracy)

    @property
    def plan(self) -> Row:
        """Return the plan for the accuracy asked."""
        return self.plans[0]

    @cached_property
    def above_round_off(self) -> list[Row]:
        """Return all measurements, with errors below `FLOOR` raised to it."""
        return [replace(row, error=max(row.error, FLOOR)) for row in self.rows]

    @cached_property
    def noise(self) -> float:
        """Return the ratio up to which two costs count as equal: 19 of 20 points have a smaller spread.

        Only points that cost at most ten times as much as the plan count, as expensive runs are timed less often.
        """
        return float(np.percentile([row.spread for row in self.rows if row.seconds <= 10.0 * self.plan.seconds], 95.0))

    def cheapest(self, families: Sequence[str], accuracy: float) -> "Offer | None":
        """Return the cheapest method of some families that reaches an accuracy."""
        return cheapest([row for row in self.above_round_off if row.family in families], accuracy)

    @cached_property
    def reaches(self) -> "list[Reach]":
        """Return the cost of the accuracy asked by each kind of method, the cheapest first."""
        return sorted(filter(None, map(self._reach, KINDS)), key=lambda reach: (reach.cost, reach.end.error))

    def _reach(self, kind: str) -> "Reach | None":
        if kind == "rbfmu's plan":
            return Reach(kind, self.plan.detail, self.plan.seconds, End(kind, self.plan.detail, self.plan.error, ""))
        ends = [end for end in self.ends if end.kind == kind and not end.never_ran]
        if not ends:
            return None
        rows = [row for row in self.above_round_off if row.kind == kind]
        offer = cheapest(rows, max(self.accuracy, FLOOR)) or Offer("", math.inf)
        end = min(ends, key=lambda end: end.error)
        return Reach(kind, offer.method, offer.cost, end, any(end.stopped for end in ends))

    # What is shown

    @cached_property
    def table(self) -> str:
        """Return the findings as text of at most 80 columns."""
        head = wrap_lines([*self.headline, f"charted: {self.conditions}"])
        ends = wrap_lines(self.absent), wrap_lines(self.machine)
        return join_parts((head, self._kinds(), self._digits(), self._models(), *ends))

    def figure(self) -> "Figure":
        """Return the picture as a figure of matplotlib."""
        from rbfmu.studies.chart.drawing import figure_of

        return figure_of(self)

    def save(self, folder: str | Path, name: str = "") -> list[Path]:
        """Write NAME.csv (all measurements), NAME.txt (the table) and NAME.png to a folder; return the files.

        name: the scene's, if none is given.
        """
        stem = re.sub(r"[^\w.-]+", "_", name or self.scene) or "scene"
        csv, text, picture = (exceptions.path_of(folder, "folder") / f"{stem}{end}" for end in (".csv", ".txt", ".png"))
        csv.parent.mkdir(parents=True, exist_ok=True)
        write_rows(csv, map(asdict, self.rows), [*self.machine, *self.absent])
        with on_disk.replacing(text, "w", newline="", encoding="utf-8") as file:
            file.write(f"{self.table}\n")
        with on_disk.replacing(picture) as file:
            self.figure().savefig(file)
        return [csv, text, picture]

    def __str__(self) -> str:
        return self.table

    def __repr__(self) -> str:
        what = f"Chart of {self.scene}: {len(self.rows)} points; print it, or save(folder)"
        return "\n".join((what, *self.headline))

    def _repr_html_(self) -> str:
        """Return picture and table for a notebook."""
        from base64 import b64encode
        from html import escape

        from rbfmu.plot import png_of

        picture = b64encode(png_of(self.figure())).decode()
        return f'<img src="data:image/png;base64,{picture}" width="880"/><pre>{escape(self.table)}</pre>'

    # The parts of the table

    @property
    def conditions(self) -> str:
        """Return how the scene was run."""
        whole = self.whole or self.span
        part = f"the first {self.span:,.8g} s of " if self.span < 0.999 * whole else ""
        text = f"{part}{whole:,.8g} s, an output every {self.span / self.outputs:,.8g} s"
        if not self.ports:
            return text
        return f"{text}; {' and '.join(self.ports)} {self.held} all the time, so that others may step over outputs"

    def _kinds(self) -> Iterator[str]:
        asked = short_number(self.accuracy)
        yield from textwrap.wrap(
            f"What an error of at most {asked} costs: processor time, for a simulated second and for the run, of the "
            f"cheapest method of each kind. Costs within a factor of {self.noise:.2f} are even.",
            WIDTH,
        )
        yield _KIND.format("kind", "cheapest method", "for 1 s", "the run", "of plan's")
        for reach in self.reaches:
            end, missed = reach.end, "stopped" if reach.stopped else "misses it"
            if math.isfinite(reach.cost):
                ratio, run = times(reach.cost / self.plan.seconds), cost_text(reach.cost * self.span)
                yield _KIND.format(reach.name, reach.method, cost_text(reach.cost), run, ratio)
            else:
                least = short_number(end.error) if math.isfinite(end.error) else "none below 1"
                line = f"{reach.name:22}{missed}: {least} by {end.method} ({end.why})"
                yield from textwrap.wrap(line, WIDTH, subsequent_indent=" " * 24)

    def _digits(self) -> Iterator[str]:
        yield "What each further digit costs, as rbfmu plans it:"
        yield _DIGIT.format("accuracy", "method", "error", "for 1 s", "of plan's")
        for row in self.plans:
            numbers = short_number(row.error), cost_text(row.seconds), times(row.seconds / self.plan.seconds)
            yield _DIGIT.format(short_number(row.value), row.detail, *numbers)
        yield from textwrap.wrap(self.why_no_further, WIDTH)

    def _models(self) -> Iterator[str]:
        if not self.too_small:
            return
        yield "Smaller models than the plan's, which do not serve:"
        yield _MODEL.format("model", "error", "of accuracy's")
        for model in self.too_small:
            if model.why:
                yield from textwrap.wrap(f"{model.model:30}{model.why}", WIDTH, subsequent_indent=" " * 32)
            else:
                ratio = f"{model.error / self.accuracy:.1e} x" if math.isfinite(model.error) else ""
                yield _MODEL.format(model.model, short_number(model.error), ratio)

    @property
    def headline(self) -> tuple[str, str]:
        """Return two lines: the cheapest method at the accuracy asked, and what it is compared with."""
        plan, first = self.plan, self.reaches[0]
        asked = f"{self.scene} at {short_number(self.accuracy)}{f', ports {self.held}' if self.ports else ''}"
        ratio, planned = plan.seconds / first.cost, f"{self.model}: {plan.detail}"
        if ratio <= self.noise:
            use = f"{asked}: use rbfmu's plan, {cost_text(plan.seconds)} per simulated second"
            return use, f"{planned}; {self._beside()}"
        cheapest = f"{asked}: cheapest is {first.method}, {cost_text(first.cost)} per simulated second"
        return cheapest, f"rbfmu's plan costs {times(ratio)} that ({planned})"

    def _beside(self) -> str:
        peer = self.cheapest(SIDES["peer"], max(self.accuracy, FLOOR))
        if peer is None:
            return "no peer meets that" if any(row.family == "peer" for row in self.rows) else "no peer is charted"
        ratio = peer.cost / self.plan.seconds
        return f"{peer.method} is even" if ratio <= self.noise else f"best peer {peer.method}, {times(ratio)} that"

    @property
    def why_no_further(self) -> str:
        """Return why the chart has no plans for further digits."""
        if self.refusal:
            return self.refusal
        return "the error is round-off, so further digits cost nothing" if self.plans[-1].error < FLOOR else ""


# The cost of an accuracy


def front(rows: Iterable[Row], gain: float = 1.0) -> list[Row]:
    """Return the Pareto front by rising cost: each error is below `gain` times that of the row before."""
    kept: list[Row] = []
    for row in sorted(rows, key=lambda row: row.seconds):
        if not kept or row.error < gain * kept[-1].error:
            kept.append(row)
    return kept


def cost_of(rows: Iterable[Row], accuracy: float) -> float | None:
    """Return the cost of an accuracy, from the rows of one method; None if the method does not reach it.

    Between two settings, the error of a method of order p is proportional to cost^-p, so that the cost is
    interpolated by a power law. Plans and closed forms have no settings in between: the next row's cost counts.
    """
    best = front(rows)
    if not best or best[-1].error > accuracy:
        return None
    if best[0].error <= accuracy:
        return best[0].seconds
    coarse, fine = next(pair for pair in pairwise(best) if pair[1].error <= accuracy)
    if fine.family in ("exact", "planned"):
        return fine.seconds
    part = math.log(coarse.error / accuracy) / math.log(coarse.error / fine.error)
    return float(coarse.seconds * (fine.seconds / coarse.seconds) ** part)


class Offer(NamedTuple):
    """A method, and the processor time in s for a simulated second with which it reaches an accuracy."""

    method: str
    cost: float


def cheapest(rows: Sequence[Row], accuracy: float) -> Offer | None:
    """Return the cheapest method of these rows that reaches an accuracy."""
    names = dict.fromkeys(row.method for row in rows)
    costs = ((name, cost_of([row for row in rows if row.method == name], accuracy)) for name in names)
    offers = [Offer(name, cost) for name, cost in costs if cost is not None]
    return min(offers, key=lambda offer: offer.cost, default=None)


class Reach(NamedTuple):
    """The cheapest method of a kind that meets the accuracy asked.

    cost: s for a simulated second, infinite if none meets the accuracy; end: that of the method with the smallest error
    of the kind; stopped: whether the time limit stopped a method of the kind, which might else reach smaller errors.
    """

    kind: str
    method: str
    cost: float
    end: End
    stopped: bool = False

    @property
    def name(self) -> str:
        """Return the name of the kind as it is shown."""
        return "closed form" if self.kind == "exact" else self.kind
