"""The campaign of plans: how long each takes, and whether what is refused is refused with a key and truly.

By hand: python -m tests.support.quadruple.plans SEED COUNT [JUDGED]; every JUDGED-th plan is judged in quadruple
precision as well.
"""

import re
import sys
import time
import warnings
from typing import NamedTuple

from rbfmu.exceptions import PlanningWarning
from rbfmu.planning.judge import MAX_SUBSTEPS
from rbfmu.planning.select import plan
from rbfmu.scene.scene import SceneError
from tests.support.quadruple.campaign import (
    DEAR,
    FAILED,
    HONEST,
    KEYLESS,
    REFUSED,
    RIGHT,
    verdict_of,
    verdict_of_refusal,
)
from tests.support.quadruple.driving import AS_PLANNED, outcome, pasted, true_motion
from tests.support.quadruple.hard_scenes import hard_scene
from tests.support.quadruple.reference import TooDearError

KEY = re.compile(r"\b(run|body|loads|initial|inputs|outputs)\.\w+ = ")
PLANNED = "planned"
MAX_SERIES = 5_000
LONG_RUN = 0.1
"""Of the substeps after which a plan is refused: what series of another kind take at least, if the refusal is true."""


class Planned(NamedTuple):
    """What became of a seed."""

    seed: int
    kind: str
    verdict: str
    seconds: float
    text: str
    scene: object


def planned(seed, judged):
    """What planning makes of a seed's scene, and where `judged` what quadruple precision says of it; None: no scene."""
    try:
        kind, scene = hard_scene(seed)
    except SceneError:
        return None
    begin = time.process_time()
    try:
        found = plan(scene)
    except SceneError as error:
        seconds = time.process_time() - begin
        return Planned(seed, kind, verdict_on(scene, str(error)), seconds, str(error), scene)
    seconds = time.process_time() - begin
    text = f"{found.model}, {found.method}, {found.error:.1e}"
    if not judged:
        return Planned(seed, kind, PLANNED, seconds, text, scene)
    try:
        verdict, _, said = verdict_of(scene, AS_PLANNED, outcome(scene, found, AS_PLANNED, MAX_SERIES))
    except TooDearError:
        verdict, said = DEAR, ""
    return Planned(seed, kind, verdict, seconds, f"{text}; {said}", scene)


def verdict_on(scene, message):
    """Whether a refusal names a key, and is true."""
    if not KEY.search(message):
        return KEYLESS
    if "run.stop" not in message:
        return verdict_of_refusal(scene, message)[0]
    try:
        true_motion(scene, AS_PLANNED, "double", int(LONG_RUN * MAX_SUBSTEPS))
    except TooDearError:
        return HONEST
    return REFUSED


def line(one):
    """What became of a seed, in a line."""
    return f"{one.seconds:5.2f} s: seed {one.seed} ({one.kind}): {one.verdict}: {one.text}"


def main(seed, count, every=0):
    """Prints failures and long plans when they come; the longest and what was refused at the end."""
    found = []
    warnings.simplefilter("ignore", PlanningWarning)
    while len(found) < count:
        one = planned(seed, every and seed % every == 0)
        seed += 1
        if one is None:
            continue
        found.append(one)
        print(line(one), file=sys.stderr, flush=True)
        if one.verdict in FAILED or one.seconds > 10.0:
            print(pasted(one.scene, AS_PLANNED, f"{one.seconds:.1f} s; {one.verdict}: {one.text}"), flush=True)
        if len(found) % 50 == 0:
            longest = max(found, key=lambda one: one.seconds)
            print(f"# {len(found)}, seed {seed}; {longest.seconds:.1f} s: seed {longest.seed}", flush=True)
    for one in sorted(found, key=lambda one: -one.seconds)[:12]:
        print(line(one))
    for one in found:
        if one.verdict not in (PLANNED, RIGHT):
            print(line(one))
    verdicts = [one.verdict for one in found]
    print({verdict: verdicts.count(verdict) for verdict in sorted(set(verdicts))})


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
