"""What plans cost on motions with torques, beside the library's methods, what others use, and the peers installed.

python examples/bench_plans.py [CASE ...]
"""

import sys
from dataclasses import replace

from rbfmu.work_precision.cases import CASES
from rbfmu.work_precision.collection import collect, extent, machine
from rbfmu.work_precision.plans import verdict_table, verdicts

REPEATS, LONGEST = 15, 0.3
"""More and longer than in `rbfmu chart`: each time is the least of as many, in turns with all others."""


def main(keys: list[str]) -> int:
    """0 where every plan is as it should be."""
    cases = [case for key, case in CASES.items() if (key in keys if keys else not case.torque_free)]
    what = replace(extent(False), cases=cases, repeats=REPEATS, longest=LONGEST)
    points, notes = collect(what, lambda done, total, text: print(f"\r{done}/{total} {text:60.60}", end="", flush=True))
    found = verdicts(points)
    print("\r" + verdict_table(found), *notes, *machine(), sep="\n")
    return int(not all(verdict.kept for verdict in found))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
