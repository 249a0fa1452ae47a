"""Charts as text, in at most 80 columns: one chart, and plans beside peers of many."""

import math
import textwrap
from collections.abc import Iterable, Iterator, Sequence

from rbfmu.studies.chart.cases import FLOOR, OUTPUT_STEP
from rbfmu.studies.chart.result import DEAREST, REFUSED, SIDES, STOPPED, Measured, Verdict

WIDTH = 80
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"), (1e-12, "ps"), (1e-15, "fs"))
_KIND = "{:22}{:29.28}{:>9}{:>9}{:>10}"
_DIGIT = "{:10}{:41.40}{:>9}{:>9}{:>10}"
_MODEL = "{:30}{:>10}{:>14}"
_PLAN = "{:>6}  {:7}  {:19}  {:>7}  {:19}  {}"


def wrap_lines(lines: Iterable[str]) -> list[str]:
    """Return lines, none of which is beyond the width."""
    return [part for line in lines for part in textwrap.wrap(line, WIDTH, subsequent_indent="  ")]


def join_parts(parts: Iterable[Iterable[str]]) -> str:
    """Return parts of lines as a text, with an empty line between those that have any."""
    return "\n\n".join(filter(None, ("\n".join(line.rstrip() for line in part) for part in parts)))


def chart_text(chart: Measured) -> str:
    """Return all that a chart says."""
    head = wrap_lines([*headline(chart), f"charted: {conditions(chart)}"])
    ends = wrap_lines(chart.absent), wrap_lines(chart.machine)
    return join_parts((head, _kinds(chart), _digits(chart), _models(chart), *ends))


def conditions(chart: Measured) -> str:
    """Return how the scene was run."""
    whole = chart.whole or chart.span
    part = f"the first {chart.span:,.8g} s of " if chart.span < 0.999 * whole else ""
    said = f"{part}{whole:,.8g} s, an output every {chart.span / chart.outputs:,.8g} s"
    if not chart.ports:
        return said
    return f"{said}; {' and '.join(chart.ports)} at zero all the time, so that others may step over outputs"


def _kinds(chart: Measured) -> Iterator[str]:
    asked = short_number(chart.accuracy)
    yield from textwrap.wrap(
        f"What an error of at most {asked} costs: processor time, for a simulated second and for the run, of the "
        f"cheapest method of each kind. Costs within a factor of {chart.noise:.2f} are even.",
        WIDTH,
    )
    yield _KIND.format("kind", "cheapest method", "for 1 s", "the run", "of plan's")
    for reach in chart.reaches:
        end, missed = reach.end, "stopped" if reach.stopped else "misses it"
        if math.isfinite(reach.cost):
            ratio, run = times(reach.cost / chart.plan.seconds), cost_text(reach.cost * chart.span)
            yield _KIND.format(reach.name, reach.method, cost_text(reach.cost), run, ratio)
        else:
            least = short_number(end.error) if math.isfinite(end.error) else "none below 1"
            said = f"{reach.name:22}{missed}: {least} by {end.method} ({end.why})"
            yield from textwrap.wrap(said, WIDTH, subsequent_indent=" " * 24)


def _digits(chart: Measured) -> Iterator[str]:
    yield "What each further digit costs, as rbfmu plans it:"
    yield _DIGIT.format("accuracy", "method", "error", "for 1 s", "of plan's")
    for row in chart.plans:
        ratio = times(row.seconds / chart.plan.seconds)
        yield _DIGIT.format(short_number(row.value), row.detail, short_number(row.error), cost_text(row.seconds), ratio)
    yield from textwrap.wrap(why_no_further(chart), WIDTH)


def _models(chart: Measured) -> Iterator[str]:
    if not chart.too_small:
        return
    yield "Smaller models than the plan's, which do not serve:"
    yield _MODEL.format("model", "error", "of accuracy's")
    for model in chart.too_small:
        if model.why:
            yield from textwrap.wrap(f"{model.model:30}{model.why}", WIDTH, subsequent_indent=" " * 32)
        else:
            ratio = f"{model.error / chart.accuracy:.1e} x" if math.isfinite(model.error) else ""
            yield _MODEL.format(model.model, short_number(model.error), ratio)


def headline(chart: Measured) -> Iterator[str]:
    """Yield two lines: which method costs least at the accuracy asked, and what is beside it."""
    plan, first = chart.plan, chart.reaches[0]
    asked = f"{chart.scene} at {short_number(chart.accuracy)}{', ports at zero' if chart.ports else ''}"
    ratio, planned = plan.seconds / first.cost, f"{chart.model}: {plan.detail}"
    if ratio <= chart.noise:
        yield f"{asked}: use rbfmu's plan, {cost_text(plan.seconds)} per simulated second"
        yield f"{planned}; {_beside(chart)}"
    else:
        yield f"{asked}: cheapest is {first.method}, {cost_text(first.cost)} per simulated second"
        yield f"rbfmu's plan costs {times(ratio)} that ({planned})"


def _beside(chart: Measured) -> str:
    peer = chart.cheapest(SIDES["peer"], max(chart.accuracy, FLOOR))
    if peer is None:
        return "no peer meets that" if any(row.family == "peer" for row in chart.rows) else "no peer is charted"
    ratio = peer.cost / chart.plan.seconds
    return f"{peer.method} is even" if ratio <= chart.noise else f"best peer {peer.method}, {times(ratio)} that"


def why_no_further(chart: Measured) -> str:
    """Return why there are no plans for further digits than the chart has."""
    if chart.refusal:
        return chart.refusal
    return "the error is round-off, so further digits cost nothing" if chart.plans[-1].error < FLOOR else ""


# Many charts


def plans_text(found: Sequence[Verdict], machine: Iterable[str]) -> str:
    """Return what plans and the best peers cost, chart by chart, and the plans that miss their goal."""
    return join_parts((*_plans(found), _dearness(found), wrap_lines(machine)))


def _plans(found: Sequence[Verdict]) -> Iterator[list[str]]:
    largest = max(v.chart.noise for v in found)
    yield textwrap.wrap(
        "Processor time for a simulated second with at most an error: as rbfmu plans it, and by the cheapest peer, at "
        "the setting that just meets the error (known in hindsight; a plan has to find it). It costs: the peer's time "
        f"over the plan's; below 1 the peer is ahead. Many outputs: one every {OUTPUT_STEP:g} s. Costs within a "
        f"chart's noise, a factor of {largest:.2f} at most, are even.",
        WIDTH,
    )
    for key in dict.fromkeys(v.chart.key for v in found):
        mine = sorted((v for v in found if v.chart.key == key), key=lambda v: v.chart.outputs)
        chart, counts = mine[0].chart, dict.fromkeys(f"{v.chart.outputs:,}" for v in mine)
        head = f"{chart.scene} ({key}), {chart.span:,.0f} s; outputs: {' or '.join(counts)}"
        yield [head, _PLAN.format("error", "outputs", "plan", "for 1 s", "best peer", "it costs"), *map(_plan, mine)]


def _plan(v: Verdict) -> str:
    cost = cost_text(v.cost) if v.method != REFUSED else ""
    peer = v.peer.method if v.peer else STOPPED if v.stopped else "none reaches it"
    return _PLAN.format(short(v.accuracy), count_of(v), method_of(v), cost, peer, against(v))


def count_of(v: Verdict) -> str:
    """Return whether outputs are few or many."""
    return "many" if v.chart.many else "few"


def method_of(v: Verdict) -> str:
    """Return a short name of a plan's method."""
    return v.method.replace("series of order", "series").replace(" of order", "").replace(" in equal steps", " fixed")


def against(v: Verdict) -> str:
    """Return the best peer's cost relative to the plan's, in words."""
    if v.peer is None:
        return ""
    if v.method == REFUSED:
        return cost_text(v.peer.cost)
    return "even" if v.even else times(v.lead)


def _dearness(found: Sequence[Verdict]) -> list[str]:
    """Return lines on plans that miss their accuracy, or cost more than the best other method at their error."""
    if not any(v.rival for v in found):
        return []
    goal = f"keeps its accuracy and costs at most {DEAREST:g} times the cheapest method that is no peer"
    missed = [_miss(v) for v in found if not v.kept]
    if not missed:
        return textwrap.wrap(f"Every plan {goal}, at the error of the plan.", WIDTH)
    return [*textwrap.wrap(f"Plans that miss the goal (a plan {goal}, at the error of the plan):", WIDTH), *missed]


def _miss(v: Verdict) -> str:
    rival = f"{v.dearness:.2f} x {v.rival.method}" if v.rival else "no other method"
    return f"  {v.chart.key}, {short(v.accuracy)}, {count_of(v)}: {method_of(v)}, error {v.error:.1e}, {rival}"


# Numbers in words


def cost_text(seconds: float) -> str:
    """Return two digits and a unit: 0.41 fs, 8.1 ps, 170 ns, 1.4 ms."""
    size, unit = next(((size, unit) for size, unit in UNITS if seconds >= 0.9995 * size), UNITS[-1])
    return f"{two_digits(seconds / size)} {unit}"


def times(ratio: float) -> str:
    """Return a ratio of costs with two digits: 0.41 x, 3.0 x, 1,200 x; beyond 1e5 with one."""
    return f"{two_digits(ratio) if ratio < 1e5 else short(ratio)} x"


def short_number(number: float) -> str:
    """Return an error or accuracy in its shortest form: 1e-6, 2e-16, 3."""
    if number == 0.0:
        return "0"
    return short(number) if number < 0.095 else two_digits(number).removesuffix(".0")


def short(number: float) -> str:
    """Return a number in its shortest form, such as 1e-9."""
    return f"{number:.0e}".replace("e-0", "e-")


def two_digits(number: float) -> str:
    """Return a number rounded to two significant digits, without an exponent."""
    number = float(f"{number:.1e}")
    return f"{number:,.{max(0, 1 - math.floor(math.log10(number)))}f}"
