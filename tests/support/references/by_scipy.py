"""Motions under loads written in Python, by SciPy's DOP853: nothing of this package but how errors count."""

import numpy as np
from scipy.integrate import solve_ivp

from rbfmu.runs.motion import attitude_error

B = {"mass": 2.0, "inertia": [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]], "r_oc_b": [0.1, -0.2, 0.3]}
"""A body whose axes are not principal, beside the reference point."""


def matrix(q):
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])  # fmt: skip


def by_scipy(tables, loads, times, own_rates=None, own=(), ports=lambda t: {}, whole=False):
    """Quaternion, omega_b, position and own states at times: nothing of this package.

    whole: whether right-hand sides take all, with the quaternion after the own states.
    """
    body, initial, pivot = tables["body"], tables["initial"], tables["body"].get("pivot", False)
    m, rc, g = body["mass"], np.array(body["r_oc_b"]), np.array(tables["loads"]["gravity_a"])
    M = np.array(body["inertia"]) + (m * (rc @ rc * np.eye(3) - np.outer(rc, rc)) if pivot else 0.0)
    damping, inverse = np.array(tables["loads"].get("damping_b", [0.0] * 3)), np.linalg.inv(M)
    q0, w0 = np.array(initial["attitude"]["quaternion"]), np.array(initial["omega_b"])
    R0, o = matrix(q0), np.array(initial.get("position", [0.0] * 3))

    def rates(t, y):
        q, w, r_c, v_c, own = y[:4], y[4:7], y[7:10], y[10:13], y[13:]
        R = matrix(q)
        p, v = (o, np.zeros(3)) if pivot else (r_c - R @ rc, v_c - R @ np.cross(w, rc))
        acting = {"force_a": np.zeros(3), "force_b": np.zeros(3), "torque_a": np.zeros(3), "torque_b": np.zeros(3)}
        acting |= loads(t, R, w, p, v, [*own, *q] if whole else own)
        torque = acting["torque_b"] + R.T @ acting["torque_a"] - damping * w + ports(t).get("torque_b", 0.0)
        force = acting["force_b"] + R.T @ acting["force_a"]
        torque = torque + (np.cross(rc, R.T @ (m * g)) if pivot else np.cross(-rc, force))
        path = [np.zeros(3), np.zeros(3)] if pivot else [v_c, g + R @ force / m]
        turn = 0.5 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))])
        more = [] if not own_rates else own_rates(t, R, w, p, v, [*own, *q]) if whole else own_rates(t, own)
        return np.concatenate([turn, inverse @ (torque - np.cross(w, M @ w)), *path, more])

    start = [q0, w0, o + R0 @ rc, np.array(initial.get("velocity", [0.0] * 3)) + R0 @ np.cross(w0, rc), own]
    found = solve_ivp(rates, (times[0], times[-1]), np.concatenate(start), "DOP853", times, rtol=1e-13, atol=1e-14).y.T
    q = found[:, :4] / np.linalg.norm(found[:, :4], axis=1)[:, None]
    return {"quaternion": q, "omega_b": found[:, 4:7], "own": found[:, 13:],
            "position": np.array([r - matrix(a) @ rc for a, r in zip(q, found[:, 7:10], strict=True)])}  # fmt: skip


def worst(result, truth, names):
    """The largest error, as an accuracy counts it."""
    found = [0.0]
    for name in names:
        if name == "quaternion":
            found.append(attitude_error(result.quaternion, truth[name]).max())
        else:
            size = max(np.linalg.norm(truth[name], axis=1).max(), 1.0 if name == "position" else 0.0)
            found.append(np.linalg.norm(getattr(result, name) - truth[name], axis=1).max() / size)
    return max(found)
