"""Members of a scene's ensemble, shown beside the scene's own motion."""

from typing import NamedTuple

import numpy as np

from rbfmu.ensembles.chunks import Work, run_chunk
from rbfmu.ensembles.members import ensemble_of
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.ensembles.variables import ALL
from rbfmu.results.result import Array
from rbfmu.scene.scene import Scene

MOST = 50


class Ghost(NamedTuple):
    """The attitude q_ab (n, 4) and the place of o in a (n, 3), m, of a member."""

    quaternion: Array
    position: Array


def check_ghosts(scene: Scene, count: int) -> None:
    """Raise ValueError for more ghosts than `MOST`, SceneError where the scene has no ensemble."""
    if not 0 <= count <= MOST:
        raise ValueError(f"ghosts = {count}: expected a number from 0 to {MOST}")
    if count:
        ensemble_of(scene)


def ghosts_of(scene: Scene, count: int) -> tuple[Ghost, ...]:
    """Return the first members of the scene's ensemble at its communication points, without those that failed."""
    if count == 0:
        return ()
    count = min(count, ensemble_of(scene).runs)
    moving = [name for name in ("position", "quaternion") if name in scene.outputs.quantities]
    shown = scene.replace({"outputs.quantities": moving, "ensemble.keep": [ALL]})
    work = Work(shown, plan_ensemble(shown), count)
    chunk = run_chunk(work, 0)
    still = np.zeros((*chunk.rows.shape[:2], 3))
    motion = work.columns.split(chunk.rows)
    positions = motion.get("position", still)
    return tuple(Ghost(motion["quaternion"][i], positions[i]) for i in range(count) if i not in chunk.failed)
