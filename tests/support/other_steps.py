"""Plans in communication steps that planning does not try: how far beyond the accuracy are they?

    python -m tests.support.other_steps

prints a line for each of twenty plans, with its error as a part of the accuracy asked, and what it is in other steps.
"""

import warnings
from collections.abc import Iterator

from rbfmu.models.question import Question
from rbfmu.planning.judge import Judge
from rbfmu.planning.select import plan
from rbfmu.scene.scene import Scene, load_scene
from tests.support.paths import ROOT

BODY = {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}
ATTITUDE_AND_RATE = {"quantities": ["quaternion", "omega_b"]}
OWN = {
    "three moments": {
        "body": {"mass": 1.0, "inertia": [0.1, 0.2, 0.25], "r_oc_b": [0.1, 0.05, 0.3], "pivot": True},
        "initial": {"omega_b": [1.0, 2.0, 3.0]}, "outputs": ATTITUDE_AND_RATE, "run": {"stop": 10.0, "step": 0.25}},
    "torque": {
        "body": BODY, "initial": {"omega_b": [1.0, 2.0, 3.0]}, "outputs": ATTITUDE_AND_RATE,
        "loads": {"torque_b": [0.1, 0.2, -0.1], "damping_b": [0.01, 0.02, 0.01]}, "run": {"stop": 20.0, "step": 0.5}},
    "thruster": {
        "body": BODY | {"r_oc_b": [0.1, 0.0, 0.1]}, "initial": {"omega_b": [0.3, 1.0, 0.2]},
        "loads": {"force_b": [0.0, 0.5, 0.3], "gravity_a": [0.0, 0.0, 0.0]},
        "outputs": {"quantities": ["quaternion", "position"]}, "run": {"stop": 20.0, "step": 0.5}},
}  # fmt: skip
SHIPPED = ("top_falling", "top_precessing")
ACCURACIES = (1e-4, 1e-6, 1e-8, 1e-10)
OTHER = (0.37, 0.83, 1.3, 1.61, 1.9, 2.7, 3.3)
"""Communication steps over that of the scene, before they are rounded to a whole number of them a run."""


def scenes() -> Iterator[Scene]:
    """Yield five motions at each accuracy."""
    own = (Scene.from_dict({"name": name} | tables) for name, tables in OWN.items())
    for scene in (*own, *(load_scene(ROOT / f"examples/scenes/{name}.toml") for name in SHIPPED)):
        yield from (scene.replace({"run.accuracy": accuracy}) for accuracy in ACCURACIES)


def in_step(scene: Scene, factor: float) -> Scene:
    """Return the scene with other communication steps."""
    span = scene.run.stop - scene.run.start
    return scene.replace({"run.step": span / max(1, round(span / (scene.run.step * factor)))})


def main() -> None:
    """Print the table, and how many runs are beyond the accuracy."""
    warnings.simplefilter("ignore")
    parts = []
    for scene in scenes():
        found, accuracy = plan(scene), scene.run.accuracy
        row = [Judge(Question(in_step(scene, factor))).try_out(found)[0] / accuracy for factor in OTHER]
        print(f"{scene.name:16} {accuracy:.0e} {found.error / accuracy:5.2f} |", *(f"{part:5.2f}" for part in row))
        parts += row
    beyond = sum(part > 1.0 for part in parts)
    print(f"{beyond} of {len(parts)} beyond the accuracy, by a factor of up to {max(parts):.1f}")


if __name__ == "__main__":
    main()
