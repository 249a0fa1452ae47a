"""What plans cost on motions with torques, beside the library's methods, what others use, and the peers installed.

`python -m examples.benchmarks.plans [--peers] [CASE ...]`; cases are keys of `CASES` in
`rbfmu.studies.work_precision.cases`. With `--peers`, plans and the fastest peers alone:
`python -m examples.pages --measure peers` takes the figures of the README's table in minutes.
Exit status 1 where a plan misses its accuracy or costs more than it should.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import replace

from rbfmu.studies.work_precision.cases import CASES
from rbfmu.studies.work_precision.collection import Collection, collect, extent, few_and_many, machine
from rbfmu.studies.work_precision.plans import Verdict, verdicts
from rbfmu.studies.work_precision.tables import dearness_table, plan_table, stopped_table, wrapped

REPEATS = 9
"""More than in `rbfmu chart`: each time is the least of as many, in turns with all others."""
FASTEST = ("rbfmu, as planned", "heyoka.py", "numbalsoda LSODA", "numbalsoda DOP853", "SciPy odeint")
"""The plan, and the peers that are the best somewhere in the whole chart."""


def collected(keys: Sequence[str], methods: Sequence[str] = ()) -> Collection:
    """Return the figures of these methods (all: none named) on these cases."""
    whole = extent(False)
    chosen = [m for m in whole.methods if not methods or m.name in methods]
    what = replace(whole, cases=tuple(few_and_many(keys)), methods=chosen, repeats=REPEATS)
    return collect(
        what, lambda done, total, text: print(f"\r{done}/{total} {text:60.60}", end="", flush=True, file=sys.stderr)
    )


def rows(found: Sequence[Verdict]) -> list[dict[str, object]]:
    """Return what the pages quote: the plan, its error and time, the best peer and its time; s of the processor."""
    return [
        {
            "case": v.case, "motion": f"{v.title}, {CASES[v.case].span:g} s", "outputs": v.outputs,
            "accuracy": v.accuracy, "plan": v.method, "error": v.error, "seconds": v.cost,
            "peer": v.peer.method if v.peer else "", "peer_seconds": v.peer.cost if v.peer else math.nan,
            "even": v.even, "noise": v.noise,
        }
        for v in sorted(found, key=lambda v: v.many)
    ]  # fmt: skip


def main(arguments: list[str]) -> int:
    """0 where every plan is as it should be."""
    keys, peers_alone = [a for a in arguments if a != "--peers"], "--peers" in arguments
    chosen = [key for key, case in CASES.items() if (key in keys if keys else not case.torque_free)]
    found = collected(chosen, FASTEST if peers_alone else ())
    judged = verdicts(found)
    tables = (plan_table(judged), dearness_table(judged), stopped_table(found), "\n".join(wrapped(machine())))
    print("\r" + "\n\n".join(filter(None, tables)))
    return int(not all(verdict.kept for verdict in judged))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
