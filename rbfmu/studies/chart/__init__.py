"""The study behind `rbfmu chart`: accuracy against cost of every method, on a scene of your own or on eight motions.

All methods and installed peers are run on a scene, with its ports constant at their start values (zero by default), and
are compared with its true motion. Charts of many motions together compare each plan with the best other methods.
"""

import math
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from rbfmu.on_disk import replacing
from rbfmu.scene.scene import Scene, of_scene_or_path
from rbfmu.studies import WIDTH, Progress, cost_text, join_parts, short, times, wrap_lines, write_rows
from rbfmu.studies.chart import cases, measure
from rbfmu.studies.chart.result import SIDES, STOPPED, Chart, Offer

__all__ = ["Chart", "chart", "run_charts", "write_charts"]

QUICK_MOTIONS = ("a", "c", "d")
DECADES = tuple(10.0**-k for k in range(2, 15))
DEAREST = 1.3
"""The largest cost that a plan may have, relative to the best other method; planning does not know the true error."""
REFUSED = "refused"
_PLAN = "{:>6}  {:7}  {:19}  {:>7}  {:19}  {}"


@of_scene_or_path
def chart(
    scene: Scene, quick: bool = False, progress: Progress | None = None, method: str | Path | None = None
) -> Chart:
    """Chart accuracy against cost of every method and installed peer on a scene, or on that of a scene file.

    quick: few methods and settings, for a first try; progress: called with (done, total, text); method: a file with
    a method of your own (`rbfmu.studies.one_step`), which is measured as well.
    A full chart takes one or two minutes. Raises SceneError if the accuracy asked cannot be met.
    """
    what = measure.extent(quick, method)
    progress = progress or (lambda done, total, text: None)
    progress(0, 1, f"{scene.name}: the true motion")
    return replace(measure.measure(cases.case_of(scene), what, progress), whole=scene.run.stop - scene.run.start)


# The charts of the eight motions, and their summary


def run_charts(folder: Path, quick: bool, progress: Progress, method: Path | None = None) -> list[Path]:
    """Chart the eight motions (quick: three of them, by few methods), and return the files written.

    progress, method: as in `chart`. The first of the text files is `answers.txt`.
    """
    keys, what = QUICK_MOTIONS if quick else tuple(cases.CASES), measure.extent(quick, method)
    return write_charts(folder, measure.charts_of(keys, what, progress))


def write_charts(folder: Path, charts: Sequence[Chart]) -> list[Path]:
    """Write all measurements, the method to use for each accuracy, and each chart; return the files."""
    from rbfmu.studies.chart.drawing import draw_answers, draw_kept

    folder.mkdir(parents=True, exist_ok=True)
    judged, head = verdicts(charts), charts[0].machine + charts[0].absent
    text = folder / "answers.txt"
    with replacing(text, "w", newline="", encoding="utf-8") as file:
        file.write(f"{plans_text(judged, charts[0].machine)}\n")
    files = [
        write_rows(folder / "work_precision.csv", (_head_of(c) | asdict(row) for c in charts for row in c.rows), head),
        write_rows(folder / "endings.csv", (_head_of(c) | end._asdict() for c in charts for end in c.ends), head),
        write_rows(folder / "answers.csv", (row for c in charts for row in answers(c)), head),
        text,
        draw_answers(judged, folder / "answers.png"),
    ]
    for each in charts:
        name = each.key.replace("'", "2")
        files += each.save(folder, f"case_{name}_many" if each.many else f"case_{name}")
        files += [] if each.many else draw_kept(each, folder / f"kept_{name}.png")
    return files


def _head_of(chart: Chart) -> dict[str, object]:
    return {"case": chart.key, "title": chart.scene, "outputs": chart.outputs}


def answers(chart: Chart) -> Iterator[dict[str, object]]:
    """Yield a row per accuracy: the cheapest method of the library, of plans, of common integrators and of peers."""
    for accuracy in DECADES:
        found = _head_of(chart) | {"accuracy": accuracy}
        for side, families in SIDES.items():
            offer = chart.cheapest(families, accuracy)
            cost = offer.cost * chart.span if offer else math.nan
            found |= {side: offer.method if offer else "", f"{side}_cost": cost}
        yield found


# Each plan compared with the best other methods


@dataclass(frozen=True)
class Verdict:
    """A plan for an accuracy, the best other method at the plan's error, and the best peer at that accuracy.

    method: the method that the plan chose; error: the plan's; cost: its processor time for a simulated second, s; both
    are infinite if planning refuses. stopped: whether the time limit stopped a peer before it reached the accuracy.
    """

    chart: Chart
    accuracy: float
    method: str
    error: float
    cost: float
    rival: Offer | None
    peer: Offer | None
    stopped: bool

    @property
    def is_refused(self) -> bool:
        """Return whether there is no plan."""
        return self.method == REFUSED

    @property
    def dearness(self) -> float:
        """Return the cost over that of the best other method; 0 if none is as accurate."""
        return self.cost / self.rival.cost if self.rival else 0.0

    @property
    def lead(self) -> float:
        """Return the best peer's cost over the plan's: infinite if no peer is as accurate, 0 if there is no plan."""
        return self.peer.cost / self.cost if self.peer else math.inf

    @property
    def even(self) -> bool:
        """Return whether both costs are equal within the noise."""
        return 1.0 / self.chart.noise <= self.lead <= self.chart.noise

    @property
    def kept(self) -> bool:
        """Return whether the plan keeps its accuracy and costs no more than `DEAREST` allows."""
        return self.error <= self.accuracy and self.dearness <= DEAREST * self.chart.noise

    # In words

    @property
    def outputs(self) -> str:
        """Return the word for the number of outputs: few or many."""
        return "many" if self.chart.many else "few"

    @property
    def plan(self) -> str:
        """Return a short name of the plan's method."""
        name = self.method.replace("series of order", "series").replace(" of order", "")
        return name.replace(" in equal steps", " fixed")

    @property
    def against(self) -> str:
        """Return the best peer's cost over the plan's, as text; without a plan, the peer's cost."""
        if self.peer is None:
            return ""
        if self.is_refused:
            return cost_text(self.peer.cost)
        return "even" if self.even else times(self.lead)


def verdicts(charts: Sequence[Chart]) -> list[Verdict]:
    """Return a verdict for each chart and each accuracy for which a plan was asked."""
    asked = {row.value for chart in charts for row in chart.rows if row.family == "planned"}
    return [_verdict(chart, accuracy) for chart in charts for accuracy in sorted(asked, reverse=True)]


def _verdict(chart: Chart, accuracy: float) -> Verdict:
    plan = next((row for row in chart.rows if row.family == "planned" and row.value == accuracy), None)
    chosen = (plan.detail, plan.error, plan.seconds) if plan else (REFUSED, math.inf, math.inf)
    error = max(min(chosen[1], accuracy), cases.FLOOR)
    peers = {row.method for row in chart.rows if row.family == "peer"}
    stopped = any(e.stopped and e.method in peers and e.error > accuracy for e in chart.ends)
    rival = chart.cheapest(SIDES["library"] + SIDES["integrator"], error)
    return Verdict(chart, accuracy, *chosen, rival, chart.cheapest(SIDES["peer"], accuracy), stopped)


def plans_text(found: Sequence[Verdict], machine: Iterable[str]) -> str:
    """Return as text the costs of plans and of the best peers, chart by chart, and the plans that miss their goal."""
    return join_parts((*_plans(found), _dearness(found), wrap_lines(machine)))


def _plans(found: Sequence[Verdict]) -> Iterator[list[str]]:
    largest = max(v.chart.noise for v in found)
    yield textwrap.wrap(
        "Processor time for a simulated second with at most an error: as rbfmu plans it, and by the cheapest peer, at "
        "the setting that just meets the error (known in hindsight; a plan has to find it). It costs: the peer's time "
        f"over the plan's; below 1 the peer is ahead. Many outputs: one every {cases.OUTPUT_STEP:g} s. Costs within a "
        f"chart's noise, a factor of {largest:.2f} at most, are even.",
        WIDTH,
    )
    for key in dict.fromkeys(v.chart.key for v in found):
        mine = sorted((v for v in found if v.chart.key == key), key=lambda v: v.chart.outputs)
        chart, counts = mine[0].chart, dict.fromkeys(f"{v.chart.outputs:,}" for v in mine)
        head = f"{chart.scene} ({key}), {chart.span:,.0f} s; outputs: {' or '.join(counts)}"
        yield [head, _PLAN.format("error", "outputs", "plan", "for 1 s", "best peer", "it costs"), *map(_plan, mine)]


def _plan(v: Verdict) -> str:
    cost = "" if v.is_refused else cost_text(v.cost)
    peer = v.peer.method if v.peer else STOPPED if v.stopped else "none reaches it"
    return _PLAN.format(short(v.accuracy), v.outputs, v.plan, cost, peer, v.against)


def _dearness(found: Sequence[Verdict]) -> list[str]:
    """Return lines on plans that miss their accuracy, or cost more than the best other method at their error."""
    if not any(v.rival for v in found):
        return []
    goal = f"keeps its accuracy and costs at most {DEAREST:g} times the cheapest method that is no peer"
    goal, missed = f"{goal}, at the error of the plan", [_miss(v) for v in found if not v.kept]
    head = f"Plans that miss the goal (a plan {goal}):" if missed else f"Every plan {goal}."
    return [*textwrap.wrap(head, WIDTH), *missed]


def _miss(v: Verdict) -> str:
    rival = f"{v.dearness:.2f} x {v.rival.method}" if v.rival else "no other method"
    return f"  {v.chart.key}, {short(v.accuracy)}, {v.outputs}: {v.plan}, error {v.error:.1e}, {rival}"
