"""Writes rbfmu/studies/stability/reference_motions.json: motions to 40 digits by `reference_mp`, rounded to doubles."""

import json
from typing import Any

import mpmath as mp
import numpy as np

from rbfmu.scene.scene import Scene
from rbfmu.studies.stability.motions import CHECK_TIMES, MOTIONS, PRESCRIBED, REFERENCES, map_scene, ratios_of_moments
from tests.support.references import reference_mp


def quaternion_of(R: Any) -> list[float]:
    """By the largest of its components, which is positive."""
    with mp.workdps(reference_mp.DIGITS):
        t = R[0][0] + R[1][1] + R[2][2]
        diagonal = [t, R[0][0], R[1][1], R[2][2]]
        k = diagonal.index(max(diagonal))
        off = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]]
        if k == 0:
            row = [1 + t, *off]
        else:
            i = k - 1
            row = [off[i], *(R[i][j] + R[j][i] if i != j else 1 + 2 * R[i][i] - t for j in range(3))]
        length = mp.sqrt(sum(x * x for x in row))
        return [float(x / length) for x in row]


def motion_of(scene: Scene, times: list[float]) -> dict[str, Any]:
    points = reference_mp.motion(scene, times)
    rows = {
        name: [[float(x) for x in getattr(p, name)] for p in points] for name in ("omega_b", "position", "velocity")
    }
    rows = {"quaternion": [quaternion_of(p.R_ab) for p in points], **rows}
    return {"scene": scene.to_dict(), **rows, **derived(scene, rows)}


def derived(scene: Scene, rows: dict[str, Any]) -> dict[str, Any]:
    """What follows from the state, as rows, by other formulas than those of the kernels which are measured."""
    R_ab, omega = np.array([_matrix(q) for q in rows["quaternion"]]), np.array(rows["omega_b"])
    M_c, r_oc = np.array(scene.body.M_c), np.array(scene.body.r_oc_b)
    v_c = np.array(rows["velocity"]) + np.einsum("nij,nj->ni", R_ab, np.cross(omega, r_oc))
    h = omega @ M_c
    energy = 0.5 * scene.body.mass * np.sum(v_c * v_c, axis=1) + 0.5 * np.sum(omega * h, axis=1)
    if scene.body.pivot:  # the momentum is about the pivot
        h = h + scene.body.mass * np.cross(r_oc, np.cross(omega, r_oc))
    found = {"omega_a": np.einsum("nij,nj->ni", R_ab, omega), "angular_momentum_a": np.einsum("nij,nj->ni", R_ab, h)}
    return {name: values.tolist() for name, values in (found | {"kinetic_energy": energy[:, None]}).items()}


def _matrix(q: list[float]) -> Any:
    e, x, y, z = q
    E = np.array([[-x, e, -z, y], [-y, z, e, -x], [-z, -y, x, e]])
    G = np.array([[-x, e, z, -y], [-y, -z, e, x], [-z, y, -x, e]])
    return E @ G.T


def communication_points(scene: Scene) -> list[float]:
    return [float(t) for t in scene.run.grid()[1:]]


def prescribed_attitudes(pieces: Any = PRESCRIBED) -> list[list[float]]:
    """dq/dt = q o (0, omega) / 2 by Taylor series, in each piece (length, omega, its first, its second derivative)."""
    with mp.workdps(reference_mp.DIGITS):
        q, found = [mp.mpf(1), mp.mpf(0), mp.mpf(0), mp.mpf(0)], []
        for h, *polynomial in pieces:
            w = [[mp.mpf(x) / mp.factorial(k) for x in row] for k, row in enumerate(polynomial)]
            terms = [q]
            for n in range(160):
                rate = [mp.mpf(0)] * 4
                for k in range(min(n, 2) + 1):
                    rate = [a + b for a, b in zip(rate, _half_product(terms[n - k], w[k]), strict=True)]
                terms.append([x / (n + 1) for x in rate])
            q = [sum(t[i] * mp.mpf(h) ** n for n, t in enumerate(terms)) for i in range(4)]
            found.append([float(x) for x in q])
        return found


def _half_product(q: Any, w: Any) -> list[Any]:
    e, x, y, z = q
    a, b, c = w
    return [(-x * a - y * b - z * c) / 2, (e * a + y * c - z * b) / 2, (e * b - x * c + z * a) / 2,
            (e * c + x * b - y * a) / 2]  # fmt: skip


def map_attitudes(ratio: float) -> list[list[float]]:
    return motion_of(map_scene(ratio), CHECK_TIMES)["quaternion"]  # type: ignore[no-any-return]


def main() -> None:
    motions = {key: motion_of(scene, communication_points(scene)) for key, scene in MOTIONS.items()}
    maps = {repr(ratio): map_attitudes(ratio) for ratio in ratios_of_moments(quick=False)}
    content = {
        "written by": "tests/support/references/stability_references.py", "motions": motions, "maps": maps,
        "prescribed": prescribed_attitudes(),
    }  # fmt: skip
    REFERENCES.write_text(json.dumps(content).replace('"quaternion"', '\n"quaternion"') + "\n")


if __name__ == "__main__":
    main()
