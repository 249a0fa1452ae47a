"""Fits to simulated noise: how often the truth lies within two standard errors.

By hand: python -m tests.support.fits SEED COUNT [PART OF OUTLIERS] [LOSS] [TIMES]
"""

import sys

import numpy as np

import rbfmu
from tests.support.quadruple.scenes import Draw

FREE = ("body.inertia", "initial.omega_b", "initial.attitude")


def truth(rng, name="truth", times=101):
    """A body with three moments, turned by a torque that is known, so that its moments can be told."""
    a, b, c = rng.uniform(0.3, 1.0, 3)
    return rbfmu.Scene.from_dict({
        "body": {"mass": 1.0, "inertia": [b + c, c + a, a + b]},
        "initial": {"omega_b": rng.uniform(-1.0, 1.0, 3).tolist(),
                    "attitude": {"rotvec": rng.uniform(-1.5, 1.5, 3).tolist()}},
        "loads": {"torque_b": rng.uniform(-0.2, 0.2, 3).tolist()},
        "outputs": {"quantities": ["omega_b", "quaternion"]},
        "run": {"stop": 10.0, "step": 10.0 / (times - 1)},
    }, name)  # fmt: skip


def measured(rng, scene, noise=0.01, outliers=0.0):
    """Rates and quaternions of either sign with noise, and some that are far off."""
    run = rbfmu.simulate(scene)
    shape = run.omega_b.shape
    turn = rbfmu.quaternion_from_rotvec(noise * rng.normal(size=shape))
    signs = rng.choice([-1.0, 1.0], size=(len(run.time), 1))
    omega_b = run.omega_b + noise * rng.normal(size=shape)
    q_ab = rbfmu.compose_quaternions(run.quaternion, turn) * signs
    far = rng.random(len(run.time)) < outliers
    omega_b[far] += rng.normal(size=(far.sum(), 3))
    q_ab[far] = rbfmu.quaternion_from_rotvec(rng.normal(size=(far.sum(), 3)))
    return {"time": run.time, "omega_b": omega_b, "quaternion": q_ab}


def start(rng, scene):
    """The scene with moments 30 % off, an attitude 60 degrees off and rates that are."""
    moments = np.diag(scene.body.inertia) * rng.choice([0.7, 1.3], 3)
    moments = np.minimum(moments, 0.95 * (moments.sum() - moments))
    turn = rbfmu.quaternion_from_rotvec(Draw(int(rng.integers(1 << 30))).vector(np.radians(60.0)))
    q_ab = rbfmu.compose_quaternions(np.array(scene.initial.quaternion), turn)
    return scene.replace({
        "body.inertia": moments.tolist(), "initial.attitude": {"quaternion": q_ab.tolist()},
        "initial.omega_b": (np.array(scene.initial.omega_b) + rng.uniform(-0.1, 0.1, 3)).tolist(),
    })  # fmt: skip


def errors(fit, scene, begun):
    """Errors over standard errors, of the moments, the rates and the attitude; NaN of what the fit does not tell."""
    turn = rbfmu.compose_quaternions(np.array(begun.initial.quaternion) * [1, -1, -1, -1], scene.initial.quaternion)
    true = [*np.diag(scene.body.inertia), *scene.initial.omega_b, *rbfmu.rotvec_from_quaternion(turn)]
    return (fit.values - true) / fit.standard_errors


def main(first, count, outliers=0.05, loss="soft_l1", times=101):
    """Print each fit's largest error, and how many of all are within two standard errors."""
    within, total = 0, 0
    for seed in range(first, first + count):
        rng = np.random.default_rng(seed)
        scene = truth(rng, times=times)
        data, begun = measured(rng, scene, outliers=outliers), start(rng, scene)
        fit = rbfmu.fit(begun, data, FREE, loss=loss if outliers else "linear")
        z = errors(fit, scene, begun)
        within, total = within + int(np.sum(np.abs(z) < 2.0)), total + len(z)
        print(seed, f"{np.nanmax(np.abs(z)):.2f}", *fit.unknown, *fit.doubts, flush=True)
    print(f"{within} of {total} within two standard errors: {100.0 * within / total:.1f} %")


if __name__ == "__main__":
    kinds = int, int, float, str, int
    main(*(kind(text) for kind, text in zip(kinds, sys.argv[1:], strict=False)))
