"""`python -m tests.support.plain_numba WITHOUT RESULTS.npz`: what is computed without one of the internals.

WITHOUT: a row of `numba_private.INTERNALS`; `broken`: all are there, and adding a pass to a compiler fails; `all`:
nothing is taken away.
"""

import sys
import types
import warnings
from typing import Any

import numba.core.compiler
import numpy as np
from numba import njit


def take_away(row: str) -> None:
    """The module without the row's name, for whoever imports it from now on; Numba itself goes on as before."""
    module, _, path = row.partition(":")
    name = path.partition(".")[0]
    whole = sys.modules[module] if module in sys.modules else __import__(module, fromlist=[name])
    rest = types.ModuleType(module)
    rest.__dict__.update({key: value for key, value in vars(whole).items() if key != name})
    assert name in vars(whole)
    assert not hasattr(rest, name)
    sys.modules[module] = rest


def break_passes() -> None:
    class PassManager(numba.core.compiler.PassManager):  # type: ignore[misc]
        def add_pass(self, *_: Any) -> None:
            raise TypeError("behaves otherwise")

    module = types.ModuleType("numba.core.compiler_machinery")
    module.__dict__.update(vars(sys.modules[module.__name__]), PassManager=PassManager)
    sys.modules[module.__name__] = module


def of_arrays() -> dict[str, Any]:
    """By name, results of calls that take each way through an array function."""
    import rbfmu

    random = np.random.default_rng(76)
    q, v = rbfmu.normalize(random.normal(size=(50, 4))), random.normal(size=(50, 3))
    axis, angle = rbfmu.axis_angle_from_quaternion(q)
    found = {"axis": axis, "angle": angle, "turned": rbfmu.rotate(q, v), "one": rbfmu.rotate(q[3], v[3])}
    found["matrix"] = rbfmu.matrix_from_quaternion(q.reshape(5, 10, 4))
    found["angles"] = rbfmu.euler_from_quaternion("ZYX", q)
    found["other angles"] = rbfmu.euler_from_quaternion("xyz", q[::-1])
    found["between"] = rbfmu.slerp(q[:1], q, 0.3)
    found["out"] = rbfmu.compose_quaternions(q, q[::-1], out=np.empty((100, 4))[::2])
    found["axes"] = rbfmu.rotvec_rate_a(v.T, np.flip(v).T, axes=[(0,), (0,), (0,)])
    found["refused"] = np.array(refusal_of(lambda: rbfmu.rotate(q, v[:, :2])))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        rbfmu.rotvec_rate_a([0.0, 2.0 * np.pi, 0.0], [1.0, 0.0, 0.0])
    return found | {"said": np.array([str(warning.message) for warning in said])}


def of_a_caller() -> dict[str, Any]:
    """What compiled code gets of kernels that are merged into it and of some that it calls."""
    import rbfmu_kernels as k

    @njit
    def turned(M: Any, q: Any) -> Any:
        return k.rotate(q, k.principal_axes(M)[0])

    return {
        "turned moments": np.array(turned(((2.0, 0.1, 0.0), (0.1, 3.0, 0.2), (0.0, 0.2, 4.0)), (0.6, 0.8, 0.0, 0.0)))
    }


def of_a_scene() -> dict[str, Any]:
    import rbfmu
    from tests.support.paths import SCENES

    run = rbfmu.simulate(SCENES / "thrown_ball.toml")
    return {f"scene/{name}": np.asarray(value) for name, value in run.quantities.items()}


def refusal_of(call: Any) -> str:
    try:
        call()
    except ValueError as error:
        return str(error)
    return "none"


def main(without: str, path: str) -> None:
    if without == "broken":
        break_passes()
    elif without != "all":
        take_away(without)
    from rbfmu_kernels.compile import numba_private

    assert (without if ":" in without else "") == numba_private.MISSING
    if without == "broken":
        from rbfmu_kernels.compile.compiler import internals_serve

        assert not internals_serve()
        np.savez(path, **of_a_caller())
    else:
        np.savez(path, **of_arrays(), **of_a_caller(), **of_a_scene())


if __name__ == "__main__":
    main(*sys.argv[1:])
