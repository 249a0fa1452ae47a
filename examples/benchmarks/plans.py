"""What plans cost on motions with torques, beside the library's methods, what others use, and the peers installed.

`python -m examples.benchmarks.plans [--peers] [CASE ...]`; cases are keys of `CASES` in
`rbfmu.studies.chart.cases`. With `--peers`, plans and the fastest peers alone:
`python -m examples.pages --measure peers` takes the figures of the README's table in minutes.
Exit status 1 where a plan misses its accuracy or costs more than it should.
"""

import math
import sys
from collections.abc import Sequence

from examples.benchmarks.support.goals import known
from rbfmu.studies.chart import Chart, Verdict, plans_text, verdicts
from rbfmu.studies.chart.cases import CASES
from rbfmu.studies.chart.measure import Extent, charts_of, machine

FASTEST = ("rbfmu, as planned", "heyoka.py", "numbalsoda LSODA", "numbalsoda DOP853", "SciPy odeint")
"""The plan, and the peers that are the best somewhere in the whole chart."""


def collected(keys: Sequence[str], methods: Sequence[str] = ()) -> list[Chart]:
    """Return the charts of these methods (all: none named) on these cases."""
    return charts_of(
        keys,
        Extent(longest=0.3, only=tuple(methods)),
        lambda done, total, text: print(f"\r{done}/{total} {text:60.60}", end="", flush=True, file=sys.stderr),
    )


def rows(found: Sequence[Verdict]) -> list[dict[str, object]]:
    """Return what the pages quote: the plan, its error and time, the best peer and its time; s of the processor."""
    return [
        {
            "case": v.chart.key, "motion": f"{v.chart.scene}, {v.chart.span:g} s", "outputs": v.chart.outputs,
            "accuracy": v.accuracy, "plan": v.method, "error": v.error, "seconds": v.cost * v.chart.span,
            "peer": v.peer.method if v.peer else "",
            "peer_seconds": v.peer.cost * v.chart.span if v.peer else math.nan,
            "even": v.even, "noise": v.chart.noise,
        }
        for v in sorted(found, key=lambda v: v.chart.many)
    ]  # fmt: skip


def main(arguments: list[str]) -> int:
    """0 where every plan is as it should be."""
    keys, peers_alone = known([a for a in arguments if a != "--peers"], CASES), "--peers" in arguments
    chosen = [key for key, case in CASES.items() if (key in keys if keys else not case.torque_free)]
    judged = verdicts(collected(chosen, FASTEST if peers_alone else ()))
    print("\r" + plans_text(judged, machine()))
    return int(not all(verdict.kept for verdict in judged))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
