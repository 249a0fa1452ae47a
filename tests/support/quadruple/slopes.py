"""Derivatives of motions by differences in quadruple precision, and those of `rbfmu.sensitivity` beside them.

By hand: python -m tests.support.quadruple.slopes SEED COUNT
"""

import sys

import numpy as np

import rbfmu
from rbfmu.scene.scene import SceneError
from tests.support.quadruple import reference
from tests.support.quadruple.scenes import random_scene

KEYS = {
    "initial.omega_b": ("omega_b_0", 3), "initial.position": ("position_0", 3), "initial.velocity": ("velocity_0", 3),
    "body.inertia": ("inertia", 6), "body.mass": ("mass", 1), "body.r_oc_b": ("r_oc_b", 3),
    "loads.gravity_a": ("gravity_a", 3), "loads.torque_a": ("torque_a", 3), "loads.force_b": ("force_b", 3),
    "loads.damping_b": ("damping_b", 3),
}  # fmt: skip
STEP = 2.0**-30
"""A change over its number's size: its square is lost, and a million units of double-double are left of it."""
INERTIA = ("1,1", "2,2", "3,3", "1,2", "1,3", "2,3")


def differences(scene, lengths, block, index):
    """Rows of each quantity, of the attitude as a rotation vector, over the change of one number, in double-double."""
    parameters = reference.parameters_of(scene)
    value = parameters[block][index]
    change = STEP * (np.max(np.abs(parameters[block])) or 1.0)

    def at(x):
        row = list(parameters[block])
        row[index] = x
        return reference.motion({**parameters, block: row}, lengths)

    plus, minus, both = at(value + change), at(value - change), (value + change) - (value - change)
    found = {n: ((plus.high[n] - minus.high[n]) + (plus.low[n] - minus.low[n])) / both for n in plus.high}
    q = at(value).high["quaternion"] * [1.0, -1.0, -1.0, -1.0]
    return found | {"attitude": 2.0 * rbfmu.compose_quaternions(q, found["quaternion"])[:, 1:]}


def worst(scene, by):
    """(error over the largest derivative of its column, output, number), the worst of all."""
    found = rbfmu.sensitivity(scene, by)
    worst_yet = (0.0, "", "")
    for n, name in enumerate(found.numbers):
        key, _, index = name.partition("[")
        block, size = KEYS[key]
        i = INERTIA.index(index[:-1]) if key == "body.inertia" else int(index[:-1]) - 1 if size > 1 else 0
        true = differences(scene, np.diff(found.time), block, i)
        for output, rows in found.of.items():
            if output == "rpy":
                continue  # which jumps by a turn
            largest = np.max(np.abs(true[output]))
            error = np.max(np.abs(rows[:, :, n] - true[output]))
            floor = 1e-9 * max(float(np.max(np.abs(found.of[output][:, :, :]))), 1e-300)
            worst_yet = max(worst_yet, (float(error / max(largest, floor)), output, name))
    return worst_yet


def chosen(scene):
    """The keys of a scene that may vary to both sides."""
    zero_damping = not any(scene.loads.damping_b)
    left = {"loads.damping_b"} if zero_damping else set()
    left |= {"initial.velocity", "loads.force_b"} if scene.body.pivot else set()
    return [key for key in KEYS if key not in left]


def main(first, count):
    """Print the worst error of each scene."""
    for seed in range(first, first + count):
        try:
            kind, scene = random_scene(seed)
            scene = scene.replace({"run.accuracy": 1e-9, "inputs": {}})
            if scene.body is None:
                continue
            error, output, number = worst(scene, chosen(scene))
            print(f"{seed} {kind} {error:.1e} {output} {number}", flush=True)
        except (SceneError, ValueError, rbfmu.SimulationError, reference.TooDearError) as error:
            print(seed, "refused:", str(error)[:200], flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
