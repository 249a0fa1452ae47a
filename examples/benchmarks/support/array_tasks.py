"""Operations on arrays: ours, a plain copy of the same data, our kernels in a plain loop, and peers."""

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import njit

import rbfmu
import rbfmu_kernels as k
from rbfmu.extras import needed_of, remedy
from rbfmu_kernels.compile.gufunc import Item, core_shapes, plain_gufunc
from rbfmu_kernels.rotations.euler_angles import sequence

with needed_of("bench"):
    from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Task:
    """One operation on arrays: ours, and what it takes and gives (numbers per item)."""

    name: str
    ours: Callable[[], Any]
    arrays: tuple[Any, ...]
    out: Any


def copy_of(task: Task) -> Callable[[], Any]:
    """Return a compiled loop that reads and writes the same rows and computes (next to) nothing."""
    rows = [a.reshape(len(a), -1) for a in task.arrays if a.ndim > 1][:2]
    out = task.out.reshape(len(task.out), -1)
    widths = [a.shape[1] for a in rows]
    key = (tuple(widths), out.shape[1])
    if key not in _COPIES:
        _COPIES[key] = _specialised(*key)
    loop = _COPIES[key]
    return lambda: loop(*rows, out)


_COPIES: dict[Any, Any] = {}


def _specialised(widths: tuple[int, ...], width: int) -> Any:
    """Return the copy with its widths as constants, as the array functions have them."""
    names = [f"a{n}" for n in range(len(widths))]
    used = range(max(*widths, width))
    cells = [" + ".join(f"{a}[i, {j % w}]" for a, w in zip(names, widths, strict=True)) for j in used]
    sums: list[str] = [""] * width
    for j, cell in enumerate(cells):  # what the result has no cell for is read all the same
        sums[j % width] = f"{sums[j % width]} + {cell}" if sums[j % width] else cell
    lines = [f"def loop({', '.join(names)}, out):", "    for i in range(out.shape[0]):"]
    scope: dict[str, Any] = {}
    exec("\n".join(lines + [f"        out[i, {j}] = {s}" for j, s in enumerate(sums)]), scope)
    return njit(scope["loop"])


def tasks(n: int) -> tuple[list[Task], dict[str, Any]]:
    """Return the operations on n items, and the arrays they share."""
    random = np.random.default_rng(1)
    q = rbfmu.normalize(random.normal(size=(n, 4)))
    p = rbfmu.normalize(random.normal(size=(n, 4)))
    data = {"q": q, "p": p, "v": random.normal(size=(n, 3)), "s": random.uniform(size=n)}
    data |= {"R": rbfmu.matrix_from_quaternion(q), "S": rbfmu.matrix_from_quaternion(p)}
    data |= {"angles": rbfmu.euler_from_quaternion("ZYX", q), "u": rbfmu.rotvec_from_quaternion(q)}
    q4, v3, m9 = np.empty_like(q), np.empty_like(data["v"]), np.empty_like(data["R"])
    d = data

    def task(name: str, call: Callable[[], Any], arrays: str, out: Any) -> Task:
        return Task(name, call, tuple(d[a] for a in arrays.split()), out)

    return [
        task("compose quaternions", lambda: rbfmu.compose_quaternions(q, p, out=q4), "q p", q4),
        task("rotate", lambda: rbfmu.rotate(q, d["v"], out=v3), "q v", v3),
        task("quaternion to matrix", lambda: rbfmu.matrix_from_quaternion(q, out=m9), "q", m9),
        task("matrix to quaternion", lambda: rbfmu.quaternion_from_matrix(d["R"], out=q4), "R", q4),
        task("compose matrices", lambda: rbfmu.compose_matrices(d["R"], d["S"], out=m9), "R S", m9),
        task("ZYX to quaternion", lambda: rbfmu.quaternion_from_euler("ZYX", d["angles"], out=q4), "angles", q4),
        task("rotation vector to quaternion", lambda: rbfmu.quaternion_from_rotvec(d["u"], out=q4), "u", q4),
        task("slerp", lambda: rbfmu.slerp(q, p, d["s"], out=q4), "q p s", q4),
        task("quaternion to ZYX", lambda: rbfmu.euler_from_quaternion("ZYX", q, out=v3), "q", v3),
    ], data


def scipy_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """Return the same operations by SciPy (scalar-last quaternions, made outside the measured call)."""
    a, b = (Rotation.from_quat(d[x][:, [1, 2, 3, 0]]) for x in "qp")
    out = np.empty_like(d["R"])
    return {
        "compose quaternions": lambda: a * b,
        "rotate": lambda: a.apply(d["v"]),
        "quaternion to matrix": a.as_matrix,
        "matrix to quaternion": lambda: Rotation.from_matrix(d["R"], assume_valid=True).as_quat(),
        "compose matrices": lambda: np.matmul(d["R"], d["S"], out=out),
        "ZYX to quaternion": lambda: Rotation.from_euler("ZYX", d["angles"]).as_quat(),
        "rotation vector to quaternion": lambda: Rotation.from_rotvec(d["u"]).as_quat(),
        "slerp": lambda: a * Rotation.from_rotvec(d["s"][:, None] * (a.inv() * b).as_rotvec()),
        "quaternion to ZYX": lambda: a.as_euler("ZYX"),
    }


def quaternion_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """By numpy-quaternion."""
    quaternion = importlib.import_module("quaternion")
    a, b = quaternion.as_quat_array(d["q"]), quaternion.as_quat_array(d["p"])
    return {
        "compose quaternions": lambda: a * b,
        "quaternion to matrix": lambda: quaternion.as_rotation_matrix(a),
        "matrix to quaternion": lambda: quaternion.from_rotation_matrix(d["R"], nonorthogonal=False),
        "rotation vector to quaternion": lambda: quaternion.from_rotation_vector(d["u"]),
        "slerp": lambda: np.slerp_vectorized(a, b, d["s"]),  # type: ignore[attr-defined]
    }


def quaternionic_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """By quaternionic."""
    quaternionic = importlib.import_module("quaternionic")
    a, b = quaternionic.array(d["q"]), quaternionic.array(d["p"])
    return {
        "compose quaternions": lambda: a * b,
        "quaternion to matrix": lambda: a.to_rotation_matrix,
        "matrix to quaternion": lambda: quaternionic.array.from_rotation_matrix(d["R"], nonorthogonal=False),
        "rotation vector to quaternion": lambda: quaternionic.array.from_rotation_vector(d["u"]),
        "slerp": lambda: quaternionic.slerp(a, b, d["s"]),
    }


def mujoco_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """By MuJoCo's functions of one item, in a Python loop over the first thousand; scaled to all."""
    mujoco = importlib.import_module("mujoco")
    q, p, v, u = (np.ascontiguousarray(d[x][:1000]) for x in "qpvu")
    q4, v3, m9 = np.empty(4), np.empty(3), np.empty(9)

    def loop(call: Callable[[int], Any]) -> Callable[[], Any]:
        return lambda: [call(i) for i in range(len(q))]

    return {
        "compose quaternions": loop(lambda i: mujoco.mju_mulQuat(q4, q[i], p[i])),
        "rotate": loop(lambda i: mujoco.mju_rotVecQuat(v3, v[i], q[i])),
        "quaternion to matrix": loop(lambda i: mujoco.mju_quat2Mat(m9, q[i])),
        "rotation vector to quaternion": loop(lambda i: mujoco.mju_axisAngle2Quat(q4, u[i], 1.0)),
    }


def plain_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """By our own kernels in Numba's `guvectorize`, one item after the other: what tiles and their transposing gain."""
    zyx = sequence("ZYX")
    kernels = {
        "compose quaternions": (k.compose_quaternions, "q p"),
        "rotate": (k.rotate, "q v"),
        "quaternion to matrix": (k.matrix_from_quaternion, "q"),
        "matrix to quaternion": (k.quaternion_from_matrix, "R"),
        "compose matrices": (k.compose_matrices, "R S"),
        "ZYX to quaternion": (k.quaternion_from_euler, "angles", zyx),
        "rotation vector to quaternion": (k.quaternion_from_rotvec, "u"),
        "slerp": (k.slerp, "q p s"),
        "quaternion to ZYX": (k.euler_from_quaternion, "q", zyx),
    }
    loop = cache(plain_gufunc)  # compiled in the first round, which is not counted

    def call(kernel: Any, arrays: str, *constants: int) -> Callable[[], Any]:
        out = np.empty((len(d["q"]), *core_shapes(kernel)[1][0]))
        return lambda: loop(Item(kernel, constants))(*(d[a] for a in arrays.split()), out=out)

    return {name: call(*given) for name, given in kernels.items()}


PEERS = {
    "plain loop": ("numba", plain_calls),
    "SciPy": ("scipy", scipy_calls),
    "numpy-quaternion": ("quaternion", quaternion_calls),
    "quaternionic": ("quaternionic", quaternionic_calls),
    "MuJoCo, one by one": ("mujoco", mujoco_calls),
}


def absent() -> list[str]:
    """Return a line for each peer that is not installed."""
    missing = [peer for peer, (module, _) in PEERS.items() if importlib.util.find_spec(module) is None]
    return [f"{peer}: not installed ({remedy('bench')})\n" for peer in missing]
