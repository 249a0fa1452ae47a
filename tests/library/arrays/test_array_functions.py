"""Array functions: the kernels' bits under NumPy's rules."""

import inspect
import math
import os
import re
import subprocess
import sys
import warnings

import numpy as np
import pytest
from numba import config, njit

import rbfmu
from rbfmu import arrays
from rbfmu_kernels.compile.gufunc import gufuncs, interpreted
from rbfmu_kernels.compile.shapes import core_shapes
from rbfmu_kernels.rotations import euler_angles, quaternion, rotation_vector
from tests.kernels.mechanics import test_inverse_dynamics, test_kinematics
from tests.kernels.rotations import test_euler_angles, test_quaternion, test_rotation, test_rotvec
from tests.support.paths import ROOT
from tests.support.references import exact
from tests.support.references.hard_cases import random_quaternions, random_vectors, rng, rotation_matrices

TABLES = [test_rotation, test_quaternion, test_euler_angles, test_rotvec, test_kinematics, test_inverse_dynamics]
LAWS = {law.name: law for module in TABLES for law in module.LAWS}
ARRAY_FUNCTIONS = {name: f for name in arrays.__all__ if hasattr(f := getattr(rbfmu, name), "__wrapped__")}
Q = np.array(random_quaternions(100, 71))
V = np.array(random_vectors(100, 72))
R = np.array(rotation_matrices(random_quaternions(100, 73)))
compiled_only = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="needs the compiled functions")


def test_every_array_function_stands_in_a_table_of_laws():
    """Or its module's own tests call it."""
    for name in ARRAY_FUNCTIONS.keys() - LAWS.keys():
        module = ARRAY_FUNCTIONS[name].__wrapped__.__module__.rpartition(".")[2]
        own = "".join(path.read_text() for path in (ROOT / "tests" / "kernels").rglob("test_*.py"))
        assert re.search(rf"\b(rbfmu|{module})\.{name}\b", own), name


def test_every_law_is_of_an_array_function():
    assert set(LAWS) <= set(ARRAY_FUNCTIONS)


def by_array_function(name, cases):
    """One row of numbers for each case."""
    columns = [np.array(column) for column in zip(*cases, strict=True)]
    if isinstance(cases[0][0], int):
        columns[0] = "ZYX"
    results = ARRAY_FUNCTIONS[name](*columns)
    results = results if isinstance(results, tuple) else (results,)
    return np.concatenate([np.reshape(r, (len(cases), -1)) for r in results], axis=1).tolist()


@pytest.mark.parametrize("name", LAWS)
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


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rbfmu.rotate(Q[:, :3], V), r"rotate: q_ab must have trailing shape \(4,\), got \(100, 3\)"),
        (lambda: rbfmu.rotate(Q, 3.0), r"rotate: v_b must have trailing shape \(3,\), got \(\)"),
        (lambda: rbfmu.transform(R[0, 0], V), r"transform: R_ab must have trailing shape \(3, 3\), got \(3,\)$"),
        (lambda: rbfmu.angular_momentum([1, 2, 3], V[0]), r"M_c must .* got \(3,\); .* np\.diag\(moments\)$"),
        (lambda: rbfmu.euler_from_matrix("ZYX", Q), r"euler_from_matrix: R_ab must have trailing shape \(3, 3\)"),
        (lambda: rbfmu.euler_from_matrix("ZZX", R), "Euler sequence"),
        (lambda: rbfmu.euler_from_matrix(R, R), "Euler sequence"),
        (lambda: rbfmu.rotate(Q[:7], V[:6]), "do not broadcast"),
        (lambda: rbfmu.rotate(["a", "b", "c", "d"], V[0]), "q_ab must be real numbers"),
        (lambda: rbfmu.normalize(Q * 1j), "q must be real numbers"),
        (lambda: rbfmu.rotate([[1.0], [1.0, 2.0]], V[0]), "q_ab must be a regular array"),
    ],
)
def test_what_does_not_fit_is_a_value_error_that_names_the_argument(call, message):
    for _ in range(2):  # before and after compilation
        with pytest.raises(ValueError, match=message):
            call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rbfmu.rotate(Q), r"rotate takes 2 arguments \(q_ab, v_b\), got 1"),
        (lambda: rbfmu.rotate(Q, V, speed=3), "rotate: unexpected keyword 'speed'; arguments are q_ab, v_b, out"),
        (lambda: rbfmu.rotate(q_ab=Q, v_a=V), "rotate: unexpected keyword 'v_a'; arguments are q_ab, v_b, out"),
        (lambda: rbfmu.rotate(v_b=V), "rotate: q_ab missing; arguments are q_ab, v_b, out"),
        (lambda: rbfmu.rotate(Q, q_ab=Q), "rotate: q_ab is given twice, by position and by name"),
        (lambda: rbfmu.rotate(Q, V, v_b=V), "rotate: v_b is given twice, by position and by name"),
        (
            lambda: rbfmu.matrix_from_euler("ZYX", rpy=V),
            "matrix_from_euler: unexpected keyword 'rpy'; arguments are angles",
        ),
        (
            lambda: rbfmu.matrix_from_euler("ZYX", V, seq="XYZ"),
            "matrix_from_euler.* multiple values for argument 'seq'",
        ),
        (lambda: rbfmu.matrix_from_euler(angles=V), "matrix_from_euler.* missing .* 'seq'"),
        (lambda: rbfmu.free_rotation(V[0], Q[0], omega_b_0=V[0]), "free_rotation: t missing"),
        (lambda: rbfmu.free_rotation(V[0], Q[0], V[0], 1.0, t=2.0), "free_rotation: t is given twice"),
    ],
)
def test_a_call_that_does_not_fit_is_a_type_error_that_names_the_argument(call, message):
    for _ in range(2):  # before and after compilation
        with pytest.raises(TypeError, match=message):
            call()


@compiled_only
@pytest.mark.parametrize(
    ("function", "args", "keywords", "error", "message"),
    [
        ("rotate", (Q, V), {"out": np.empty((99, 3))}, ValueError, r"out must have shape \(100, 3\), got \(99, 3\)"),
        ("rotate", (Q, V, np.empty((100, 4))), {}, ValueError, r"out must have shape \(100, 3\), got \(100, 4\)"),
        ("rotate", (Q, V), {"out": np.empty((100, 3), int)}, TypeError, "out must hold floats, got int64"),
        ("rotate", (Q, V), {"out": [1.0]}, TypeError, r"out must be an array, got \[1.0\]"),
        ("rotate", (Q, V), {"out": (V, V)}, ValueError, "out must be one array, got 2"),
        (
            "rotate",
            (Q, V),
            {"out": np.broadcast_to(V[0], (100, 3))},
            ValueError,
            "out must be an array that can be written",
        ),
        ("axis_angle_from_quaternion", (Q,), {"out": V}, ValueError, "out must be a tuple of 2 arrays, got 1"),
        ("axis_angle_from_quaternion", (Q,), {"out": (None, V)}, ValueError, r"out\[1\] must have shape \(100,\)"),
        ("rotvec_rate_a", (V, V), {"out": Q}, ValueError, r"out must have shape \(100, 3\), got \(100, 4\)"),
        ("rotate", (Q, V), {"where": Q[:, 0] > 0}, TypeError, r"where is not supported; .* q_ab\[mask\]"),
        ("rotvec_rate_a", (V, V), {"where": True}, TypeError, r"where is not supported; .* u\[mask\]"),
        ("rotate", (Q, V), {"dtype": np.float32}, TypeError, "dtype = float32: all is computed in float64"),
        ("rotate", (Q, V), {"casting": "bold"}, ValueError, "casting must be one of"),
        ("rotate", (Q, V), {"axes": [(0,)]}, ValueError, "axes should be a list"),
        (
            "free_rotation",
            (np.array([1.0, 2.0, 2.5]), Q[0], V[0], V),
            {"out": (Q, V)},
            ValueError,
            r"out\[0\] must have shape \(100, 3, 4\)",
        ),
    ],
)
def test_a_keyword_that_does_not_fit_is_named(function, args, keywords, error, message):
    for _ in range(2):  # before and after compilation
        with pytest.raises(error, match=f"^{function}: {message}"):
            getattr(rbfmu, function)(*args, **keywords)


@compiled_only
def test_out_may_have_further_leading_axes():
    out = np.empty((2, 100, 3))
    assert (rbfmu.rotate(Q, V[0], out=out) == rbfmu.rotate(Q, V[0])).all()
    with pytest.raises(ValueError, match=r"rotate: casting"):
        rbfmu.rotate(Q, V[0], out=out, casting="bold")


def test_array_functions_are_documented():
    for name, function in ARRAY_FUNCTIONS.items():
        assert function.__name__ == name
        assert function.__doc__


def arguments_of(name):
    """Names and values: five items, the sequence by its name."""
    kernel = ARRAY_FUNCTIONS[name].__wrapped__
    shapes = core_shapes(kernel)[0]
    random = rng(75)
    sequences = {} if shapes.keys() == inspect.signature(kernel).parameters.keys() else {"seq": "ZXZ"}
    return sequences | {key: random.uniform(0.5, 1.5, (5, *shape)) for key, shape in shapes.items()}


def numbers(results):
    return [r.tolist() for r in (results if isinstance(results, tuple) else (results,))]


@pytest.mark.parametrize("name", ARRAY_FUNCTIONS)
def test_arguments_may_be_given_by_name(name):
    """All of them, in any order, or the last ones only; `repr`, since a NaN equals none."""
    function, arguments = ARRAY_FUNCTIONS[name], arguments_of(name)
    expected = repr(numbers(function(*arguments.values())))
    assert repr(numbers(function(**dict(reversed(arguments.items()))))) == expected
    first, *rest = arguments
    assert repr(numbers(function(arguments[first], **{key: arguments[key] for key in rest}))) == expected


@pytest.mark.parametrize("name", ARRAY_FUNCTIONS)
def test_signatures_name_the_arguments(name):
    """As `help` shows them. The kernel's annotations are of one item's tuples, and are left out."""
    parameters = inspect.signature(ARRAY_FUNCTIONS[name]).parameters
    assert list(parameters) == [*arguments_of(name), "out"]
    assert all(p.annotation is inspect.Parameter.empty for p in parameters.values())


def test_out_goes_with_names():
    out = np.empty((100, 3))
    assert rbfmu.rotate(q_ab=Q, v_b=V, out=out) is out
    assert (out == rbfmu.rotate(Q, V)).all()


@compiled_only
@pytest.mark.parametrize("rate", ["compose_omega", "rotvec_rate_a"])
def test_axes_are_those_of_numpy(rate):
    """Core axes first, also where a function watches for singular arguments."""
    arguments = {"compose_omega": (V, R, V[::-1]), "rotvec_rate_a": (V, V[::-1])}[rate]
    cores = [(0, 1) if a.ndim == 3 else (0,) for a in arguments] + [(0,)]
    turned = [np.moveaxis(a, 0, -1) for a in arguments]
    found = getattr(rbfmu, rate)(*turned, axes=cores)
    assert (getattr(rbfmu, rate)(*arguments) == found.T).all()


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


@pytest.mark.parametrize("number", [0.0, math.nan, math.inf, -1e300, 5e-324])
@pytest.mark.parametrize("name", LAWS)
def test_no_kernel_raises(name, number):
    """Whatever the numbers, also in plain Python (NUMBA_DISABLE_JIT=1)."""
    arguments, _ = core_shapes(LAWS[name].kernel)
    takes_sequence = isinstance(LAWS[name].cases()[0][0], int)
    sequence = [euler_angles.ZXZ] if takes_sequence else []
    LAWS[name].kernel(*sequence, *(exact.rounded(np.full(shape, number).tolist()) for shape in arguments.values()))


def test_nan_stays_where_it_is_and_nothing_warns():
    spoiled = Q.copy()
    spoiled[3, 2] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for function in (rbfmu.normalize, rbfmu.matrix_from_quaternion, rbfmu.rotvec_from_quaternion):
            bad = np.isnan(function(spoiled)).reshape(100, -1).any(axis=1)
            assert np.flatnonzero(bad).tolist() == [3]


@pytest.mark.parametrize(("rate", "omega"), [("euler_rate_a", V), ("euler_rate_b", V[0])])
def test_singular_euler_rates_warn_of_gimbal_lock(rate, omega):
    angles = np.full((100, 3), 0.3)
    function = getattr(rbfmu, rate)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        expected = function("ZYX", angles, omega)
    angles[60, 1] = math.pi / 2
    text = (
        rf"{rate}: some of these Euler angles ZYX are in gimbal lock \(\|det E\| < 4 eps: the middle angle is -90 or 90"
    )
    with pytest.warns(RuntimeWarning, match=text) as record:
        rates = function("ZYX", angles, omega)
    assert [w.filename for w in record] == [__file__]
    assert np.isfinite(rates).all()
    assert (np.delete(rates, 60, axis=0) == np.delete(expected, 60, axis=0)).all()
    with pytest.warns(RuntimeWarning, match="Euler angles ZXZ .* the middle angle is 0 or 180 deg"):
        assert not np.isfinite(function("ZXZ", [0.1, 0.0, 0.2], omega)).all()


def test_singular_rotation_vector_rates_warn_of_the_full_turn():
    with pytest.warns(RuntimeWarning, match="rotvec_rate_a: some of these rotation vectors are full turns"):
        rbfmu.rotvec_rate_a([0.0, 2.0 * math.pi, 0.0], V[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rbfmu.rotvec_rate_a([0.0, 0.0, 0.0], V[0])


@pytest.mark.parametrize("t", [1.0, [1.0, 2.0]])
def test_moments_of_no_body_warn_of_the_moments(t):
    with pytest.warns(RuntimeWarning, match="free_rotation: some of these moments are of no body"):
        assert np.isnan(rbfmu.free_rotation([1.0, 2.0, -1.0], Q[0], V[0], t)[1]).all()


def test_numpy_s_error_state_rules_the_warning():
    with np.errstate(divide="ignore"), warnings.catch_warnings():
        warnings.simplefilter("error")
        rbfmu.euler_rate_a("ZYX", [0.0, math.pi / 2, 0.0], V[0])
    with np.errstate(divide="raise"), pytest.raises(FloatingPointError, match="gimbal lock"):
        rbfmu.euler_rate_a("ZYX", [0.0, math.pi / 2, 0.0], V[0])


@pytest.fixture
def two_threads(monkeypatch):
    monkeypatch.setattr(rbfmu.arrays.from_kernel, "CHUNK", 16)
    monkeypatch.setattr(rbfmu.arrays.from_kernel, "THRESHOLD", 64)
    rbfmu.set_threads(2)
    yield
    rbfmu.set_threads(1)


CALLS = [
    lambda: rbfmu.rotate(Q, V),
    lambda: rbfmu.rotate(Q[0], V),
    lambda: rbfmu.transform(R[:4, np.newaxis], V),
    lambda: rbfmu.slerp(Q, Q[::-1], 0.3),
    lambda: rbfmu.axis_angle_from_quaternion(Q)[1],
    lambda: rbfmu.euler_from_quaternion("ZYX", Q.reshape(2, 50, 4)),
    lambda: rbfmu.rotate(Q, V, out=np.empty((100, 3))),
    lambda: rbfmu.rotate(Q[3], V[3]),
]


@pytest.mark.parametrize("number", range(len(CALLS)))
def test_threads_give_the_same_bits(number, two_threads):
    threaded = CALLS[number]()
    rbfmu.set_threads(1)
    alone = CALLS[number]()
    assert threaded.shape == alone.shape
    assert (threaded == alone).all()


def test_threads_warn_and_raise_as_one_does(two_threads):
    angles = np.full((100, 3), math.pi / 2)
    with pytest.warns(RuntimeWarning, match="euler_rate_a") as record:
        rbfmu.euler_rate_a("ZYX", angles, V)
    assert [w.filename for w in record] == [__file__]
    with pytest.raises(ValueError, match="v_b must have trailing shape"):
        rbfmu.rotate(Q, V[:, :2])
    with pytest.raises(ValueError, match="do not broadcast"):
        rbfmu.rotate(Q, V[:99])


@compiled_only
def test_threads_obey_the_caller_s_error_state(two_threads):
    with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
        rbfmu.euler_rate_a("ZYX", np.full((100, 3), math.pi / 2), V)


def test_there_is_at_least_one_thread():
    with pytest.raises(ValueError, match="at least 1"):
        rbfmu.set_threads(0)


@compiled_only
@pytest.mark.parametrize(
    "kernel", [quaternion.rotate, quaternion.angle_between, rotation_vector.axis_angle_from_quaternion]
)
def test_interpreted_functions_have_the_same_bits(kernel):
    args = {"rotate": (Q, V[:1]), "angle_between": (Q, Q[3])}.get(kernel.__name__, (Q,))
    ours, theirs = interpreted(kernel)(*args), gufuncs(kernel)[0](*args)
    for a, b in zip(ours, theirs, strict=True):
        assert (a == b).all()


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


def test_random_rotations_are_uniform():
    """Of the tests' own generator: the mean of R over all rotations is 0 (1/sqrt(3 n), five standard deviations)."""
    mean = rbfmu.matrix_from_quaternion(random_quaternions(3000, int(rng(74).integers(100)))).mean(axis=0)
    assert np.abs(mean).max() <= 5.0 / math.sqrt(3 * 3000)
