"""The campaign: random scenes planned, driven as by an importer, judged in quadruple precision.

By hand: python -m tests.support.quadruple.campaign SEED COUNT [FAILURES.md]
"""

import collections
import signal
import sys
import time
from typing import NamedTuple

from rbfmu.planning.select import plan, with_all_outputs
from rbfmu.scene.scene import SceneError
from rbfmu_fmu.description import describe
from tests.support.quadruple import reference
from tests.support.quadruple.driving import BEYOND, Outcome, Setting, blur, outcome, pasted, plainly_met
from tests.support.quadruple.scenes import random_scene
from tests.support.quadruple.settings import random_settings

MAX_SERIES = 1500
PATIENCE = 20
"""s of CPU for a plan, after which the scene is left alone and said."""
RIGHT, SILENT, REFUSED, KEYLESS, DEAR, UNPLANNED = (
    "right", "SILENT", "REFUSED THOUGH MET", "NO KEY NAMED", "dear", "unplanned",
)  # fmt: skip
HONEST = "refused"
FAILED = (SILENT, REFUSED, KEYLESS)


class Finding(NamedTuple):
    """One setting, and what became of it."""

    seed: int
    kind: str
    model: str
    label: str
    verdict: str
    error: float
    accuracy: float
    text: str
    scene: object
    setting: Setting

    def __str__(self):
        head = f"seed {self.seed} ({self.kind}; {self.model}; {self.label}): {self.verdict}: {self.text}"
        return pasted(self.scene, self.setting, head)


class TooLongError(Exception):
    """A plan takes more than anyone waits for."""


def within_patience(function, *arguments):
    """(result, s of CPU); TooLongError after PATIENCE s of CPU."""

    def stop(*_):
        raise TooLongError

    begin = time.process_time()
    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE)
    try:
        return function(*arguments), time.process_time() - begin
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def findings(seed):
    """All settings of one random scene, judged; (finding, s of CPU for its plan)."""
    try:
        kind, scene = random_scene(seed)
    except SceneError:
        return
    make = lambda *what: Finding(seed, kind, *what)  # noqa: E731
    accuracy = scene.run.accuracy
    full = scene.body is not None and seed % 10 == 0
    try:
        planned, seconds = within_patience(plan, scene, full)
    except TooLongError:
        yield (
            make("none", "plan", UNPLANNED, 0.0, accuracy, f"more than {PATIENCE} s of CPU", scene, Setting()),
            PATIENCE,
        )
        return
    except SceneError as error:
        judged = with_all_outputs(scene) if full else scene
        yield make("none", "plan", *verdict_of_refusal(judged, str(error)), scene, Setting()), 0.0
        return
    offered = offered_by(scene, planned)
    for label, setting in random_settings(seed, scene, offered):
        if any(block not in offered for block in setting.changes):
            continue
        try:
            found = outcome(scene, planned, setting, MAX_SERIES)
        except reference.TooDearError as error:
            yield make(planned.model, label, DEAR, 0.0, accuracy, str(error), scene, setting), seconds
            continue
        verdict, error, text = verdict_of(scene, setting, found)
        yield (
            make(planned.model, label, verdict, error, accuracy, f"{text} [{planned.method}]", scene, setting),
            seconds,
        )
        seconds = 0.0


def offered_by(scene, planned):
    """Parameters of the scene's FMU: block name -> values."""
    values = collections.defaultdict(list)
    for v in describe(scene, planned).variables:
        if v.causality == "parameter":
            values[v.block].append(v.start)
    return dict(values)


def verdict_of_refusal(scene, message):
    """Verdict, error, accuracy, text."""
    accuracy = scene.run.accuracy
    if "run.accuracy" not in message and "run.stop" not in message:  # or it is too long, as it is for the reference
        return REFUSED, 0.0, accuracy, message
    if scene.body is None:
        return HONEST, 0.0, accuracy, message
    try:
        plain = plainly_met(scene, most=MAX_SERIES)
    except reference.TooDearError as error:
        return DEAR, 0.0, accuracy, str(error)
    met = f"{message}; plain series in double precision reach {plain:.1e}"
    by_luck = BEYOND * plain > accuracy or blur(scene, MAX_SERIES) > accuracy
    return HONEST if by_luck else REFUSED, plain, accuracy, met


def verdict_of(scene, setting, found: Outcome):
    """Verdict, error, text."""
    accuracy = scene.run.accuracy
    if not found.refused:
        worst = max(found.errors, key=found.errors.get)
        text = f"{worst} {found.error:.2g}, {found.error / accuracy:.2g} times the accuracy {accuracy:g}"
        if found.error <= BEYOND * accuracy:
            return RIGHT, found.error, text
        plain = plainly_met(scene, setting, MAX_SERIES)
        return SILENT, found.error, f"{text}; plain series in double precision reach {plain:.1e}"
    keys = set(setting.changes) - set(scene.inputs.parameters)
    if keys:
        named = any(key in found.refused for key in setting.changes)
        return HONEST if named else KEYLESS, 0.0, found.refused
    try:
        plain = plainly_met(scene, setting, MAX_SERIES)
    except reference.TooDearError as error:
        return DEAR, 0.0, str(error)
    text = f"{found.refused}; plain series in double precision reach {plain:.1e}"
    return REFUSED if BEYOND * plain <= accuracy else HONEST, plain, text


def settings_from(seed, count):
    """Findings of scenes of seeds from `seed` on, until `count` settings are judged."""
    judged = 0
    while judged < count:
        for finding, seconds in findings(seed):
            judged += finding.verdict not in (DEAR, UNPLANNED)
            yield finding, seconds
        seed += 1


def table(found):
    """Counts by model, label and verdict."""
    counts = collections.Counter((f.model, f.label, f.verdict) for f in found)
    verdicts = sorted({f.verdict for f in found})
    lines = [
        "| model | setting | " + " | ".join(verdicts) + " | worst / accuracy |",
        "|---" * (len(verdicts) + 3) + "|",
    ]
    for model, label in sorted({key[:2] for key in counts}):
        ratios = [
            f.error / f.accuracy for f in found if (f.model, f.label) == (model, label) and f.verdict in (RIGHT, SILENT)
        ]
        cells = [str(counts[model, label, v] or "") for v in verdicts]
        lines.append(f"| {model} | {label} | " + " | ".join(cells) + f" | {max(ratios, default=0):.2g} |")
    return "\n".join(lines)


def main(seed, count, path=None):
    """Prints each failure when it comes, and the table at the end; slow plans as figures."""
    found, slow = [], []
    for finding, seconds in settings_from(seed, count):
        found.append(finding)
        if seconds > 10.0:
            slow.append(f"seed {finding.seed} ({finding.kind}): {seconds:.0f} s of CPU for its plan")
        if finding.verdict in FAILED:
            print(finding, "\n", flush=True)
            if path:
                with open(path, "a") as file:
                    file.write(f"```toml\n{finding}\n```\n")
        if len(found) % 20 == 0:
            print(f"# {len(found)} settings, seed {finding.seed}", file=sys.stderr, flush=True)
    print(table(found), *slow, f"{len(found)} settings of seeds {seed} to {found[-1].seed}", sep="\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:4])
