"""What plans cost on motions with torques, beside the library's methods, what others use, and the peers installed.

`python -m examples.benchmarks.plans [--peers] [CASE ...]`; cases are keys of `CASES` in
`rbfmu.studies.work_precision.cases`. With `--peers`, plans and the fastest peers alone:
`python -m examples.benchmarks.plans --peers a d c "c'" f` prints the README's table in minutes.
Exit status 1 where a plan misses its accuracy or costs more than it should.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace

from rbfmu.studies.work_precision.answers import text_of
from rbfmu.studies.work_precision.cases import CASES
from rbfmu.studies.work_precision.collection import STOPPED, collect, extent, few_and_many, machine
from rbfmu.studies.work_precision.plans import REFUSED, Verdict, verdicts
from rbfmu.studies.work_precision.tables import against, dearness_table, plan_table, short, stopped_table, wrapped

REPEATS = 9
"""More than in `rbfmu chart`: each time is the least of as many, in turns with all others."""
FASTEST = ("rbfmu, as planned", "heyoka.py", "numbalsoda LSODA", "numbalsoda DOP853", "SciPy odeint")
"""The plan, and the peers that are the best somewhere in the whole chart."""


def markdown(found: Sequence[Verdict]) -> str:
    """Return the README's table: time as planned for 1e-9, the best peer's cost over it, bold where that is ahead."""
    accuracies = sorted({v.accuracy for v in found}, reverse=True)
    head = ["motion", "outputs", "plan, 1e-9", *(f"best peer, {short(x)}" for x in accuracies)]
    rows = [head, ["---"] * len(head)]
    for case, many in dict.fromkeys((v.case, v.many) for v in sorted(found, key=lambda v: v.many)):
        mine = {v.accuracy: v for v in found if (v.case, v.many) == (case, many)}
        start = [f"{CASES[case].title}, {CASES[case].span:g} s", f"{mine[1e-9].outputs:,}", text_of(mine[1e-9].cost)]
        rows.append([*start, *map(quoted, mine.values())])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def quoted(v: Verdict) -> str:
    """Return a peer and its cost over the plan's."""
    if v.peer is None or v.method == REFUSED:
        return f"{v.peer.method}; plan refuses" if v.peer else STOPPED if v.stopped else "none"
    text = f"{v.peer.method} {against(v).removesuffix(' x')}"
    return f"**{text}**" if v.lead < 1.0 and not v.even else text


def main(arguments: list[str]) -> int:
    """0 where every plan is as it should be."""
    keys, peers_alone = [a for a in arguments if a != "--peers"], "--peers" in arguments
    chosen = [key for key, case in CASES.items() if (key in keys if keys else not case.torque_free)]
    whole = extent(False)
    methods = [m for m in whole.methods if not peers_alone or m.name in FASTEST]
    what = replace(whole, cases=tuple(few_and_many(chosen)), methods=methods, repeats=REPEATS)
    found = collect(
        what, lambda done, total, text: print(f"\r{done}/{total} {text:60.60}", end="", flush=True, file=sys.stderr)
    )
    judged = verdicts(found)
    tables = (plan_table(judged), dearness_table(judged), stopped_table(found), "\n".join(wrapped(machine())))
    print("\r" + "\n\n".join(filter(None, tables)), markdown(judged), sep="\n\n")
    return int(not all(verdict.kept for verdict in judged))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
