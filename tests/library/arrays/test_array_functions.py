"""Array functions: the kernels' bits under NumPy's rules, and torque-free motion in use."""

import inspect
import math
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from numba import njit

import rbfmu
import rbfmu_kernels
from rbfmu_kernels import free_rotation as body_at
from rbfmu_kernels.compile import tiered
from rbfmu_kernels.compile.gufunc import Item, core_shapes, gufuncs, interpreted
from rbfmu_kernels.exact.free_rotation import free_rotation_at, free_rotation_setup
from rbfmu_kernels.exact.free_rotation_setup import FREE_ROTATION_SIZE
from rbfmu_kernels.rotations import euler_angles, quaternion, rotation_vector
from rbfmu_kernels.types import SHAPES
from tests.kernels.mechanics import test_inverse_dynamics, test_kinematics, test_spatial
from tests.kernels.rotations import (
    test_attitude_error,
    test_euler_angles,
    test_quaternion,
    test_rodrigues,
    test_rotation,
    test_rotvec,
)
from tests.support.array_arguments import ARRAY_FUNCTIONS, Q, R, V, compiled_only
from tests.support.covering import some_of
from tests.support.fmu.fmus import bench
from tests.support.paths import ROOT
from tests.support.references import by_ellipj, exact
from tests.support.references.free_rotation_mp import angle_to, random_case
from tests.support.references.hard_cases import rng

TABLES = [
    test_rotation, test_quaternion, test_euler_angles, test_rotvec, test_rodrigues, test_attitude_error,
    test_kinematics, test_inverse_dynamics, test_spatial,
]  # fmt: skip
LAWS = {law.name: law for module in TABLES for law in module.LAWS}


def test_every_array_function_stands_in_a_table_of_laws():
    """Or its module's own tests call it."""
    for name in ARRAY_FUNCTIONS.keys() - LAWS.keys():
        module = ARRAY_FUNCTIONS[name].__wrapped__.__module__.rpartition(".")[2]
        own = "".join(path.read_text() for path in (ROOT / "tests" / "kernels").rglob("test_*.py"))
        assert re.search(rf"\b(rbfmu|{module})\.{name}\b", own), name


def by_array_function(name, cases):
    """One row of numbers for each case."""
    columns = [np.array(column) for column in zip(*cases, strict=True)]
    if isinstance(cases[0][0], int):
        columns[0] = "ZYX"
    with np.errstate(divide="ignore"):  # poles of Euler angles are among the cases, and would be warned of
        results = ARRAY_FUNCTIONS[name](*columns)
    results = results if isinstance(results, tuple) else (results,)
    return np.concatenate([np.reshape(r, (len(cases), -1)) for r in results], axis=1).tolist()


@pytest.mark.parametrize("name", some_of([*LAWS], 8))
def test_array_function_has_the_kernel_s_bits(name):
    """Vectorised or not: 100 items are tiles of 32 and a remainder. Euler angles: ZYX, compiled as a constant."""
    cases = [case for case in LAWS[name].cases() if not isinstance(case[0], int) or case[0] == euler_angles.ZYX][-100:]
    assert by_array_function(name, cases) == [exact.flat(LAWS[name].kernel(*case)) for case in cases]


@pytest.mark.parametrize("sequence", ["ZXZ", "xyz"])
def test_sequences_compiled_as_constants_have_the_kernel_s_bits(sequence):
    seq = euler_angles.sequence(sequence)
    ours = rbfmu.euler_from_quaternion(sequence, Q)
    assert ours.tolist() == [list(euler_angles.euler_from_quaternion(seq, tuple(q))) for q in Q.tolist()]


def strided(array):
    """The same numbers, every other one of a larger array, core axes reversed in memory."""
    larger = np.full(tuple(2 * n for n in array.shape), np.nan)
    view = larger[tuple(slice(None, None, -2) for _ in array.shape)]
    view[...] = array
    return view


@pytest.mark.parametrize(
    ("function", "args"),
    [(rbfmu.rotate, (Q, V)), (rbfmu.transform, (R, V)), (rbfmu.slerp, (Q, Q[::-1], np.linspace(0, 1, 100)))],
)
def test_layout_in_memory_does_not_matter(function, args):
    expected = function(*args)
    assert (function(*map(strided, args)) == expected).all()
    assert (function(*(np.asfortranarray(a) for a in args)) == expected).all()
    out = strided(np.zeros_like(expected))
    assert function(*args, out=out) is out
    assert (out == expected).all()


def test_one_item_for_all_has_the_same_bits():
    """Packed arguments and one that is broadcast, packed or not, in whole tiles and a remainder."""
    for one in (Q[7], strided(Q)[7], np.asfortranarray(Q)[7]):
        assert (rbfmu.rotate(one, V) == rbfmu.rotate(np.array([Q[7]] * 100), V)).all()
    assert (rbfmu.transform(R, V[5]) == rbfmu.transform(R, np.array([V[5]] * 100))).all()
    assert (rbfmu.slerp(Q[3], Q, 0.3) == rbfmu.slerp(np.array([Q[3]] * 100), Q, np.full(100, 0.3))).all()


def test_leading_axes_broadcast():
    assert rbfmu.rotate(Q[0], V).shape == (100, 3)
    assert (rbfmu.rotate(Q[0], V)[7] == rbfmu.rotate(Q[0], V[7])).all()
    all_pairs = rbfmu.transform(R[:5, np.newaxis], V[:40])
    assert all_pairs.shape == (5, 40, 3)
    assert (all_pairs[3, 35] == rbfmu.transform(R[3], V[35])).all()
    assert rbfmu.rotation_z(np.zeros((2, 3))).shape == (2, 3, 3, 3)
    assert rbfmu.quaternion_from_axis_angle(V[:4] / np.linalg.norm(V[:4], axis=1, keepdims=True), 0.3).shape == (4, 4)


def test_no_items_are_no_error():
    assert rbfmu.rotate(np.empty((0, 4)), np.empty((0, 3))).shape == (0, 3)
    assert rbfmu.euler_from_quaternion("ZYX", np.empty((0, 4))).shape == (0, 3)


def test_one_item_may_be_a_list_of_integers():
    assert rbfmu.rotate([1, 0, 0, 0], [1, 2, 3]).tolist() == [1.0, 2.0, 3.0]
    assert isinstance(rbfmu.angle_between([1, 0, 0, 0], [0, 1, 0, 0]), float)
    assert rbfmu.rotate(Q.astype(np.float32)[0], V[0]).dtype == np.float64


def test_several_results_and_their_out():
    axis, angle = rbfmu.axis_angle_from_quaternion(Q)
    outs = (np.empty((100, 3)), np.empty(100))
    returned = rbfmu.axis_angle_from_quaternion(Q, out=outs)
    assert returned[0] is outs[0]
    assert (outs[0] == axis).all()
    assert (outs[1] == angle).all()


def test_results_may_overwrite_an_argument():
    vectors, matrices = V.copy(), R.copy()
    rbfmu.rotate(Q, vectors, out=vectors)
    assert (vectors == rbfmu.rotate(Q, V)).all()
    rbfmu.compose_matrices(matrices, R[::-1], out=matrices)
    assert (matrices == rbfmu.compose_matrices(R, R[::-1])).all()


def test_results_may_be_unaligned():
    expected = rbfmu.rotate(Q, V)
    out = np.empty(expected.nbytes + 3, np.uint8)[3:].view(np.float64).reshape(expected.shape)
    assert (rbfmu.rotate(Q, V, out=out) == expected).all()


@pytest.mark.parametrize("name", some_of([*LAWS], 6))
def test_kernels_take_arrays_for_tuples(name):
    case = LAWS[name].cases()[-1]
    arrays = [np.array(argument) if isinstance(argument, tuple) else argument for argument in case]
    found, expected = (exact.flat(LAWS[name].kernel(*arguments)) for arguments in (arrays, case))
    assert repr([*map(float, found)]) == repr([*map(float, expected)])  # a NaN equals none


@compiled_only
@pytest.mark.parametrize(
    "kernel", [quaternion.rotate, quaternion.angle_between, rotation_vector.axis_angle_from_quaternion]
)
def test_interpreted_functions_have_the_same_bits(kernel):
    args = {"rotate": (Q, V[:1]), "angle_between": (Q, Q[3])}.get(kernel.__name__, (Q,))
    ours, theirs = interpreted(Item(kernel))(*args), gufuncs(Item(kernel))[0](*args)
    for a, b in zip(ours, theirs, strict=True):
        assert (a == b).all()


HARD = 0.0, math.nan, math.inf, -1e300, 5e-324


@pytest.mark.parametrize("name", [name for name in ARRAY_FUNCTIONS if name != "free_rotation"])
def test_plain_python_divides_by_zero_as_compiled_code_does(name):
    """Whatever the numbers, it raises nothing and gives the same; `repr`, since a NaN equals none."""
    kernel, random = getattr(rbfmu_kernels, name), rng(76)
    shapes = core_shapes(kernel)[0]
    sequence = [euler_angles.ZXZ] * (len(inspect.signature(kernel).parameters) - len(shapes))
    for k in range(60):
        drawn = [random.choice([0.0, 1.0, -1.0, math.nan], s, p=[0.55, 0.2, 0.2, 0.05]) for s in shapes.values()]
        if k < len(HARD):
            drawn = [np.full(shape, HARD[k]) for shape in shapes.values()]
        numbers = [exact.rounded(argument.tolist()) for argument in drawn]
        assert repr(tiered.interpreted(kernel)(*sequence, *numbers)) == repr(kernel(*sequence, *numbers))


@pytest.mark.thorough
@compiled_only
def test_cached_functions_load_without_the_compiler(tmp_path):
    """Some 0.2 s of a new process's first call; the module stands for all that Numba loads when it compiles."""
    calls = "rbfmu.rotate([0.6, 0.8, 0, 0], [1, 2, 3]), rbfmu.nearest_rotation([[1, 2, 3], [4, 5, 6], [7, 8, 10]])"
    code = f"import sys, rbfmu; print({calls}, 'numba.np.arraymath' in sys.modules)"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    compiling, loading = (
        subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    )
    assert compiling.endswith("True\n")
    assert loading == compiling.replace("True", "False")


@compiled_only
def test_kernels_are_callable_from_compiled_code():
    @njit
    def path_length(q, steps):
        total = 0.0
        for _ in range(steps):
            turned = quaternion.compose_quaternions(q, quaternion.normalize((1.0, 0.01, 0.0, 0.0)))
            total += quaternion.angle_between(q, turned)
            q = turned
        return total

    step = 2.0 * math.atan(0.01)
    assert path_length((1.0, 0.0, 0.0, 0.0), 100) == pytest.approx(100 * step, rel=1e-13)


# Exact torque-free motion


I_123, Q_0, OMEGA = (1.0, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5), (0.3, 1.0, 0.2)


@compiled_only
def test_constants_fit_a_flat_buffer_and_serve_in_compiled_code():
    @njit
    def last(setup, n):
        for i in range(n):
            state = free_rotation_at(setup, 0.5 * i)
        return state

    setup = free_rotation_setup(I_123, Q_0, OMEGA)
    buffer = np.array(setup)
    assert buffer.shape == (FREE_ROTATION_SIZE,)
    assert buffer.dtype == np.float64
    assert last(tuple(buffer.tolist()), 11) == body_at(I_123, Q_0, OMEGA, 5.0)


def test_constants_have_a_shape_of_their_own_and_other_tuples_of_floats_none():
    assert core_shapes(free_rotation_at)[0] == {"setup": (FREE_ROTATION_SIZE,), "t": ()}
    assert core_shapes(free_rotation_setup)[1] == [(FREE_ROTATION_SIZE,)]
    assert tuple[float, ...] not in SHAPES


def test_array_function_equals_the_kernel_over_bodies_and_times():
    rng = np.random.default_rng(5)
    cases = [random_case("generic", rng) for _ in range(3)]
    moments, q_0, omega_0, _ = (np.array(a) for a in zip(*cases, strict=True))
    times = np.array([[0.0], [1.0], [1e6], [-3.0]])
    q, omega = rbfmu.free_rotation(moments, q_0, omega_0, times)
    assert (q.shape, omega.shape) == ((4, 3, 4), (4, 3, 3))
    one_each = rbfmu.free_rotation(moments, q_0, omega_0, times[2])
    out = (np.empty((4, 3, 4)), np.empty((4, 3, 3)))
    assert rbfmu.free_rotation(moments, q_0, omega_0, times, out=out)[0] is out[0]
    np.testing.assert_array_equal(out[0], q)
    for k, case in enumerate(cases):
        for j, t in enumerate(times[:, 0].tolist()):
            assert body_at(*case[:3], t) == (tuple(q[j, k].tolist()), tuple(omega[j, k].tolist()))
        np.testing.assert_array_equal(one_each[0][k], q[2, k])


@pytest.mark.parametrize(("arguments", "message"), [
    (((1.0, 2.0), Q_0, OMEGA, 1.0), "moments must have trailing shape"),
    ((I_123, Q_0, OMEGA, "now"), "t must be "),
    ((I_123, Q_0, np.ones((3, 3)), np.ones(4)), "do not broadcast"),
])  # fmt: skip
def test_array_function_names_the_wrong_argument(arguments, message):
    with pytest.raises(ValueError, match=f"free_rotation: .*{message}"):
        rbfmu.free_rotation(*arguments)
    with pytest.raises(TypeError, match="takes 4 arguments"):
        rbfmu.free_rotation(I_123, Q_0)


def test_rk4_of_the_cost_unit_is_right():
    y = bench("free_rotation").rk4_steps(I_123, Q_0, OMEGA, 1e-3, 1000)
    assert angle_to(y[:4], body_at(I_123, Q_0, OMEGA, 1.0)[0]) < 1e-12


@pytest.mark.parametrize("rates", [(0.3, -1.0, 0.2), (1.0, 0.2, 0.1), (0.1, 0.2, -1.0)])
def test_the_textbook_with_elliptic_functions_of_scipy_tells_the_same(rates):
    times = np.linspace(0.0, 40.0, 50)
    theirs = by_ellipj.motion(by_ellipj.MOMENTS, np.array(rates), times)
    ours = rbfmu.free_rotation(by_ellipj.MOMENTS, by_ellipj.Q_0, rates, times)
    signs = np.sign(np.sum(theirs[0] * ours[0], axis=1))[:, None]
    np.testing.assert_allclose(signs * theirs[0], ours[0], atol=1e-12)
    np.testing.assert_allclose(theirs[1], ours[1], atol=1e-12)


def test_arrays_have_no_other_names():
    with pytest.raises(AttributeError, match=r"module 'rbfmu\.arrays' has no attribute 'roatte'"):
        getattr(rbfmu.arrays, "roatte")  # noqa: B009 - by its dot it is a useless expression
