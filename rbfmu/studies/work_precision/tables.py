"""The chart's figures for the terminal, in at most 80 columns."""

import math
import textwrap
from collections.abc import Iterable, Sequence

from rbfmu.studies.work_precision.answers import rounded, text_of
from rbfmu.studies.work_precision.cases import CASES, CHECKPOINTS, OUTPUT_STEP, described
from rbfmu.studies.work_precision.collection import STOPPED, Collection
from rbfmu.studies.work_precision.plans import DEAREST, REFUSED, Verdict

WIDTH = 80
_ROW = "{:>6}  {:7}  {:19}  {:>7}  {:19}  {}"


def plan_table(found: Sequence[Verdict]) -> str:
    """Return a table of what plans and the best peers cost, motion by motion."""
    noise = found[0].noise
    lines = _paragraph(
        "Processor time of a whole run that stays within an attitude error (rad): as rbfmu plans it, and by the "
        "cheapest peer, at the setting that just meets the error (known in hindsight; a plan has to find it). All "
        f"give attitude and rates, at few outputs and at many, one every {OUTPUT_STEP:g} s. It costs: the peer's time "
        "over the plan's; below 1 the peer is ahead. Costs within a factor of "
        f"{noise:.2f} are even: 19 of 20 costs came no further apart between two halves of this run's repeats."
    )
    for case in dict.fromkeys(verdict.case for verdict in found):
        mine = [verdict for verdict in found if verdict.case == case]
        lines += ["", described(CASES[case])]
        lines.append(_ROW.format("error", "outputs", "plan", "time", "best peer", "it costs"))
        lines += [_row(v) for v in sorted(mine, key=lambda v: v.outputs)]
    return "\n".join(line.rstrip() for line in lines)


def _row(v: Verdict) -> str:
    cost = text_of(v.cost) if math.isfinite(v.cost) else ""
    peer = v.peer.method if v.peer else STOPPED if v.stopped else "none reaches it"
    return _ROW.format(short(v.accuracy), "many" if v.many else "few", method_of(v), cost, peer, against(v)).rstrip()


def short(number: float) -> str:
    """Return a number in its shortest form, such as 1e-9."""
    return f"{number:.0e}".replace("e-0", "e-")


def method_of(v: Verdict) -> str:
    """Return a short name of a plan's method."""
    return v.method.replace("series of order", "series").replace(" of order", "").replace(" in equal steps", " fixed")


def against(v: Verdict) -> str:
    """Return the best peer's cost relative to the plan's, in words."""
    if v.peer is None:
        return ""
    if v.method == REFUSED:
        return text_of(v.peer.cost)
    if v.even:
        return "even"
    return f"{rounded(v.lead)} x"


def dearness_table(found: Sequence[Verdict]) -> str:
    """Return a table of plans that miss their accuracy, or cost more than the best other method at their error."""
    if not any(v.rival for v in found):
        return ""
    missed = [v for v in found if not v.kept]
    goal = f"keeps its accuracy and costs at most {DEAREST:g} times the cheapest method that is no peer"
    if not missed:
        return "\n".join(_paragraph(f"Every plan {goal}, at the error of the plan."))
    return "\n".join(
        [*_paragraph(f"Plans that miss the goal (a plan {goal}, at the error of the plan):"), *map(_miss, missed)]
    )


def _miss(v: Verdict) -> str:
    rival = f"{v.dearness:.2f} x {v.rival.method}" if v.rival else "no other method"
    many = "many" if v.many else "few"
    return f"  {v.case}, {short(v.accuracy)}, {many}: {method_of(v)}, error {v.error:.1e}, {rival}"


def stopped_table(found: Collection) -> str:
    """Return a table of the methods that the time limit stopped, and of the cases."""
    lines = _paragraph(
        f"{STOPPED} ({1e3 * found.limit:g} ms of processor a run). These could be more accurate, given time; the "
        f"smallest error that they came to (many: outputs every {OUTPUT_STEP:g} s):"
    )
    by_method: dict[str, list[str]] = {}
    for e in found.endings:
        if e.stopped:
            error = short(e.error) if math.isfinite(e.error) else "none"
            many = " many" if e.outputs > CHECKPOINTS else ""
            by_method.setdefault(e.method, []).append(f"{e.case}{many} {error}")
    for method, places in by_method.items():
        lines += textwrap.wrap(f"{method}: {', '.join(places)}", WIDTH, initial_indent="  ", subsequent_indent="    ")
    return "\n".join(lines) if by_method else ""


def _paragraph(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH)


def wrapped(lines: Iterable[str]) -> list[str]:
    """Return lines, none of which is beyond the width."""
    return [part for line in lines for part in textwrap.wrap(line, WIDTH, subsequent_indent="  ")]
