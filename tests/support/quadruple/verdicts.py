"""What became of a case of `mended_scenes`: planned, driven, judged."""

import time
from typing import NamedTuple

from rbfmu.planning.select import plan
from rbfmu.scene.scene import SceneError
from tests.support.quadruple.driving import BEYOND, outcome, plainly_met
from tests.support.scenes.mended_scenes import Case


class Verdict(NamedTuple):
    """right: whether the case is as it should be; error: None where refused; seconds: of CPU, for planning."""

    right: bool
    text: str
    error: float | None
    seconds: float
    model: str = ""


def judged(case: Case) -> Verdict:
    """Plan, drive and judge."""
    begin = time.process_time()
    try:
        planned = plan(case.scene, case.full)
    except SceneError as error:
        seconds = time.process_time() - begin
        return Verdict(_may_refuse(case, str(error)), f"refused: {error}", None, seconds)
    seconds = time.process_time() - begin
    found = outcome(case.scene, planned, case.setting)
    model = f"{planned.model}, {planned.method}, promised {planned.error:.1e}"
    if found.refused:
        return Verdict(_may_refuse(case, found.refused), f"refused: {found.refused}", None, seconds, model)
    accuracy = case.scene.run.accuracy
    text = f"{found.error:.2g} where {accuracy:g} was asked"
    return Verdict(found.error <= BEYOND * accuracy, text, found.error, seconds, model)


def _may_refuse(case: Case, message: str) -> bool:
    """A refusal for accuracy is right only where plain series in double precision do not meet it either."""
    if not (case.may_refuse and any(key in message for key in case.keys)):
        return False
    return "run.accuracy" not in message or plainly_met(case.scene) > case.scene.run.accuracy
