"""The members of an ensemble: what is drawn for each, what is applied, and the scene of one."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles.members import correlation, designs
from rbfmu.ensembles.members.applied import applied
from rbfmu.ensembles.members.inertia import impossible, thin
from rbfmu.scene.body import SHAPES
from rbfmu.scene.ensemble import GRID, Ensemble
from rbfmu.scene.fields import Numbers
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.scene.variations import ATTITUDE, INERTIA, RULES, SHAPE

Array = NDArray[np.float64]
ATTEMPTS = 100
"""How often a member whose inertia no body has is drawn again; after that it stays, and is refused."""


@dataclass(frozen=True)
class Samples:
    """Members of an ensemble, one a row.

    first: the number of the first member; applied: SI numbers (count, ...) by the key of the scene, attitudes q_ab as
    quaternions, scalar first, inertia as matrices; drawn: the numbers behind these (count,), in the file's units, those
    that are relative as factors; redrawn: how often each member was drawn again, as no body has its inertia.
    """

    first: int
    applied: Mapping[str, Array]
    drawn: Mapping[str, Array]
    redrawn: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.redrawn)


def ensemble_of(scene: Scene) -> Ensemble:
    """Return the scene's ensemble. Raises SceneError where there is none."""
    if scene.ensemble is None:
        expected = 'a table [ensemble.vary] with keys that vary, such as "body.mass" = { normal = [50.0, 0.5] }'
        raise SceneError(f"ensemble is missing: expected {expected}", scene.name)
    return scene.ensemble


def with_runs(scene: Scene, runs: int | None) -> Scene:
    """Return the scene with so many runs, if any are given. Raises SceneError without an ensemble, or of a grid."""
    ensemble_of(scene)
    return scene if runs is None else scene.replace({"ensemble.runs": runs})


def draw(scene: Scene, first: int, count: int) -> Samples:
    """Return `count` >= 1 members from number `first` on; a member's row is the same whichever others are asked for.

    Raises SceneError without an ensemble, ValueError for members that it does not have.
    """
    ensemble = ensemble_of(scene)
    if not 0 <= first < first + count <= ensemble.runs:
        raise ValueError(f"draw: first = {first}, count = {count}: expected members of the {ensemble.runs} runs")
    found = _sampled(scene, first, designs.points(ensemble, first, count))
    return found if ensemble.design == GRID else _possible(scene, found)


def at(scene: Scene, cube: Array) -> Samples:
    """Return the members at points (count, n) of the unit cube, whether their inertia is possible or not."""
    return _sampled(scene, 0, cube)


def _sampled(scene: Scene, first: int, cube: Array) -> Samples:
    drawn = correlation.values(ensemble_of(scene), cube)
    return Samples(first, applied(scene, drawn, len(cube)), drawn, np.zeros(len(cube), dtype=np.int64))


def _possible(scene: Scene, found: Samples) -> Samples:
    """Return the members, those whose inertia no body has drawn again: all numbers, by the member's own stream."""
    if ensemble_of(scene).of(INERTIA) is None:
        return found
    rows = _to_draw_again(found)
    for attempt in range(1, ATTEMPTS + 1):
        if not len(rows):
            break
        cube = designs.again(ensemble_of(scene), found.first, len(found), attempt)[rows]
        other = _sampled(scene, 0, cube)
        for mine, theirs in ((found.applied, other.applied), (found.drawn, other.drawn)):
            for key, values in mine.items():
                values[rows] = theirs[key]
        found.redrawn[rows] += 1
        rows = rows[_to_draw_again(other)]
    return found


def _to_draw_again(samples: Samples) -> NDArray[np.int64]:
    """Return the rows whose inertia is impossible, but for those that no positive mass has: they are refused."""
    rows = impossible(samples.applied[INERTIA])
    mass = samples.applied.get("body.mass")
    return rows if mass is None else rows[mass[rows] > 0.0]


# Scenes of members


def member(scene: Scene, samples: Samples, row: int) -> Scene:
    """Return the scene of one member, as a user would have written it. Raises SceneError where it is refused."""
    changes: dict[str, Any] = {"ensemble": None}
    for key, values in samples.applied.items():
        value = values[row].tolist()
        if key == ATTITUDE:
            changes[key] = {"quaternion": value}
        elif not key.startswith(f"{SHAPE}."):
            changes[key] = value
    try:
        _check_shape(scene, samples, row)
        return scene.replace(changes)
    except SceneError as error:
        raise SceneError(error.faults, f"{scene.name}, member {samples.first + row}") from None


def refused(scene: Scene, samples: Samples) -> dict[int, str]:
    """Return the rows of members that are no scenes, with what is wrong with each: the scene's own checks."""
    messages = {}
    for row in np.unique(np.concatenate(list(_doubtful(scene, samples)))).tolist():
        try:
            member(scene, samples, row)
        except SceneError as error:
            messages[row] = str(error)
    return messages


def _check_shape(scene: Scene, samples: Samples, row: int) -> None:
    """Raise SceneError for a shape that a scene refuses; its inertia may not tell."""
    shape = scene.ensemble.of(SHAPE) if scene.ensemble else None
    if shape is not None:
        sizes = {key.removeprefix(f"{SHAPE}."): value[row].tolist() for key, value in samples.applied.items()
                 if key.startswith(f"{SHAPE}.")}  # fmt: skip
        SHAPES[shape.form].read({"kind": shape.form, **sizes})


def _doubtful(scene: Scene, samples: Samples) -> list[NDArray[np.int64]]:
    """Return rows that a scene's checks may refuse; they are few, but for slender beams."""
    found = [np.empty(0, dtype=np.int64)]
    for key, values in samples.applied.items():
        rows = values.reshape(len(samples), -1)
        good = np.isfinite(rows).all(axis=1)
        rule = _rule(scene, key)
        if rule is not None and not rule.holds(float(rows.min())):
            good &= np.array([rule.holds(least) for least in rows.min(axis=1).tolist()])
        found.append(np.flatnonzero(~good))
    M = samples.applied.get(INERTIA)
    if M is not None:
        found += [impossible(M), thin(M)]
    elif scene.body is not None and len(thin(np.array([scene.body.inertia]))):
        found.append(np.arange(len(samples)))
    return found


def _rule(scene: Scene, key: str) -> Numbers | None:
    """Return the rule of a key whose numbers have a lower bound, if any."""
    rule = RULES.get(key)
    if key.startswith(f"{SHAPE}.") and scene.ensemble is not None:
        shape = scene.ensemble.of(SHAPE)
        rule = SHAPES[shape.form]._rule(key.removeprefix(f"{SHAPE}.")) if shape else None  # type: ignore[assignment]
    return rule if rule is not None and rule.bound else None
