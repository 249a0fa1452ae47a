"""How array functions take their arguments: by name, with `out` and NumPy's keywords; what does not fit is named."""

import inspect
import pickle
from fractions import Fraction

import numpy as np
import pytest

import rbfmu
import rbfmu_kernels
from rbfmu_kernels.compile.gufunc import core_shapes
from tests.support.array_arguments import ARRAY_FUNCTIONS, Q, R, V, compiled_only
from tests.support.covering import some_of
from tests.support.references.hard_cases import rng


@pytest.mark.parametrize(("call", "message"), [
    (lambda: rbfmu.rotate(Q[:, :3], V), r"rotate: q_ab must have trailing shape \(4,\), got \(100, 3\)"),
    (lambda: rbfmu.rotate(Q, 3.0), r"rotate: v_b must have trailing shape \(3,\), got \(\)"),
    (lambda: rbfmu.transform(R[0, 0], V), r"transform: R_ab must have trailing shape \(3, 3\), got \(3,\)$"),
    (lambda: rbfmu.angular_momentum([1, 2, 3], V[0]), r"M_c must .* got \(3,\); .* np\.diag\(moments\)$"),
    (lambda: rbfmu.euler_from_matrix("ZYX", Q), r"euler_from_matrix: R_ab must have trailing shape \(3, 3\)"),
    (lambda: rbfmu.euler_from_matrix("ZZX", R), "Euler sequence"),
    (lambda: rbfmu.euler_from_matrix(R, R), "Euler sequence"),
    (lambda: rbfmu.rotate(Q[:7], V[:6]), "do not broadcast"),
    (lambda: rbfmu.inertia_of_points(np.ones((2, 3)), np.ones((4, 3, 3))), "points: leading .* do not broadcast"),
    (lambda: rbfmu.rotate(["a", "b", "c", "d"], V[0]), "q_ab must be real numbers"),
    (lambda: rbfmu.normalize(Q * 1j), "q must be real numbers"),
    (lambda: rbfmu.rotate([[1.0], [1.0, 2.0]], V[0]), "q_ab must be a regular array"),
])  # fmt: skip
def test_what_does_not_fit_is_a_value_error_that_names_the_argument(call, message):
    for _ in range(2):  # before and after compilation
        with pytest.raises(ValueError, match=message):
            call()


@pytest.mark.parametrize(("call", "message"), [
    (lambda: rbfmu.rotate(Q), r"rotate takes 2 arguments \(q_ab, v_b\), got 1"),
    (lambda: rbfmu.rotate(Q, V, speed=3), "rotate: unexpected keyword 'speed'; arguments are q_ab, v_b, out"),
    (lambda: rbfmu.rotate(q_ab=Q, v_a=V), "rotate: unexpected keyword 'v_a'; arguments are q_ab, v_b, out"),
    (lambda: rbfmu.rotate(v_b=V), "rotate: q_ab missing; arguments are q_ab, v_b, out"),
    (lambda: rbfmu.rotate(Q, q_ab=Q), "rotate: q_ab is given twice, by position and by name"),
    (lambda: rbfmu.rotate(Q, V, v_b=V), "rotate: v_b is given twice, by position and by name"),
    (lambda: rbfmu.matrix_from_euler("ZYX", rpy=V),
     "matrix_from_euler: unexpected keyword 'rpy'; arguments are seq, angles, out"),
    (lambda: rbfmu.matrix_from_euler("ZYX", V, seq="XYZ"), "matrix_from_euler.* multiple values for argument 'seq'"),
    (lambda: rbfmu.matrix_from_euler("ZYX", 0.1, 0.2, 0.3), r"takes 2 arguments \(seq, angles\), got 4"),
    (lambda: rbfmu.matrix_from_euler(angles=V), "matrix_from_euler.* missing .* 'seq'"),
    (lambda: rbfmu.free_rotation(V[0], Q[0], omega_b_0=V[0]), "free_rotation: t missing"),
    (lambda: rbfmu.free_rotation(V[0], Q[0], V[0], 1.0, t=2.0), "free_rotation: t is given twice"),
])  # fmt: skip
def test_a_call_that_does_not_fit_is_a_type_error_that_names_the_argument(call, message):
    for _ in range(2):  # before and after compilation
        with pytest.raises(TypeError, match=message):
            call()


@pytest.mark.parametrize("spoil", [list, np.array], ids=["list", "array"])
@pytest.mark.parametrize("number", ["a", 1j, None])
def test_what_is_no_number_is_told_in_short_among_many(number, spoil):
    rows = [[0.0, 0.0, number]] * 999
    calls = {
        "v_b": lambda: rbfmu.rotate(Q[0], spoil(rows)),
        "angles": lambda: rbfmu.matrix_from_euler("ZYX", spoil(rows)),
        "positions": lambda: rbfmu.inertia_of_points(np.ones(999), spoil(rows)),
        "sequence": lambda: rbfmu.matrix_from_euler(spoil(rows), "ZYX"),
    }
    for argument, call in calls.items():
        with pytest.raises(ValueError, match=argument) as raised:
            call()
        assert len(str(raised.value)) < 400


@compiled_only
def test_numbers_beyond_float64_are_named():
    if np.can_cast(np.longdouble, float):
        pytest.skip("long doubles are doubles here")
    with pytest.raises(ValueError, match="rotate: v_b must fit into float64, got an array of float"):
        rbfmu.rotate(Q, V.astype(np.longdouble))
    with pytest.raises(ValueError, match="free_rotation: omega_b_0 must fit into float64"):  # also side by side
        rbfmu.free_rotation([1, 2, 3], Q[0], V[:9, None].astype(np.longdouble), [0.0, 1.0])


@pytest.mark.thorough
def test_tables_of_others_give_their_numbers():
    """By their places: whatever their labels, and without what these packages make of results."""
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    q, v = pandas.DataFrame(Q, columns=list("wxyz"), index=range(7, 107)), pandas.DataFrame(V, columns=list("zyx"))
    calls = [
        (rbfmu.rotate(q, v), rbfmu.rotate(Q, V)),
        (rbfmu.cross(v, v[["x", "z", "y"]]), rbfmu.cross(V, V[:, [2, 0, 1]])),
        (rbfmu.matrix_from_quaternion(xarray.DataArray(Q, dims=("time", "q"))), rbfmu.matrix_from_quaternion(Q)),
        (rbfmu.euler_from_quaternion("ZYX", q), rbfmu.euler_from_quaternion("ZYX", Q)),
        (rbfmu.rotvec_rate_a(v, V), rbfmu.rotvec_rate_a(V, V)),
        (rbfmu.rotation_z(v["z"]), rbfmu.rotation_z(V[:, 0])),
        (rbfmu.free_rotation([1, 2, 3], q.iloc[0], v.iloc[0], v["z"])[0],
         rbfmu.free_rotation([1, 2, 3], Q[0], V[0], V[:, 0])[0]),
    ]  # fmt: skip
    for found, expected in calls:
        assert type(found) is np.ndarray
        np.testing.assert_array_equal(found, expected)


def test_objects_that_are_numbers_are_taken_as_such():
    """A mass in whole numbers beyond 64 bits; a row of a table that has words elsewhere."""
    assert (rbfmu.sphere_inertia(6 * 10**24, 2) == rbfmu.sphere_inertia(6e24, 2.0)).all()
    row = np.array([1.0, 0, np.float32(2.0), Fraction(1, 2), "a name"], dtype=object)
    assert (rbfmu.normalize(row[:4]) == rbfmu.normalize([1.0, 0.0, 2.0, 0.5])).all()
    assert rbfmu.inertia_of_points([10**30], [[1, 2, 3]])[0] == 1e30
    with pytest.raises(ValueError, match=r"sphere_inertia: mass must be real numbers, got 1000"):
        rbfmu.sphere_inertia(10**400, 2)


def test_masked_items_are_refused():
    """NumPy would mask single components of results that all components of an argument make."""
    masked = np.ma.masked_array(V, mask=V > 1.0)
    calls = {
        "rotate: v_b": lambda: rbfmu.rotate(Q, masked),
        "rotvec_rate_a: u": lambda: rbfmu.rotvec_rate_a(masked, V),
        "inertia_of_points: positions": lambda: rbfmu.inertia_of_points(np.ones(100), masked),
        "free_rotation: omega_b_0": lambda: rbfmu.free_rotation([1, 2, 3], Q[0], masked, 1.0),
    }
    for where, call in calls.items():
        with pytest.raises(ValueError, match=f"{where} must have no mask"):
            call()


@compiled_only
@pytest.mark.parametrize(("function", "args", "keywords", "error", "message"), [
    ("rotate", (Q, V), {"out": np.empty((99, 3))}, ValueError, r"out must have shape \(100, 3\), got \(99, 3\)"),
    ("rotate", (Q, V, np.empty((100, 4))), {}, ValueError, r"out must have shape \(100, 3\), got \(100, 4\)"),
    ("rotate", (Q, V), {"out": np.empty((100, 3), int)}, TypeError, "out must hold floats, got int64"),
    ("rotate", (Q, V), {"out": [1.0]}, TypeError, r"out must be an array, got \[1.0\]"),
    ("rotate", (Q, V), {"out": (V, V)}, ValueError, "out must be one array, got 2"),
    ("rotate", (Q, V), {"out": np.broadcast_to(V[0], (100, 3))}, ValueError,
     "out must be an array that can be written"),
    ("rotate", (Q, V), {"out": np.ma.zeros((100, 3))}, ValueError, "out must have no mask"),
    ("axis_angle_from_quaternion", (Q,), {"out": V}, ValueError, "out must be a tuple of 2 arrays, got 1"),
    ("axis_angle_from_quaternion", (Q,), {"out": (None, V)}, ValueError, r"out\[1\] must have shape \(100,\)"),
    ("rotvec_rate_a", (V, V), {"out": Q}, ValueError, r"out must have shape \(100, 3\), got \(100, 4\)"),
    ("rotate", (Q, V), {"where": Q[:, 0] > 0}, TypeError, r"where is not supported; .* q_ab\[mask\]"),
    ("rotvec_rate_a", (V, V), {"where": True}, TypeError, r"where is not supported; .* u\[mask\]"),
    ("rotate", (Q, V), {"dtype": np.float32}, TypeError, "dtype = float32: all is computed in float64"),
    ("rotate", (Q, V), {"casting": "bold"}, ValueError, "casting must be one of"),
    ("rotate", (Q, [1, 0, 0]), {"casting": "no"}, TypeError, "Cannot cast ufunc .* input 1 from .*int64"),
    ("rotate", (Q, V), {"axes": [(0,)]}, ValueError, "axes should be a list"),
    ("free_rotation", (np.array([1.0, 2.0, 2.5]), Q[0], V[0], V), {"out": (Q, V)}, ValueError,
     r"out\[0\] must have shape \(100, 3, 4\)"),
])  # fmt: skip
def test_a_keyword_that_does_not_fit_is_named(function, args, keywords, error, message):
    for _ in range(2):  # before and after compilation
        with pytest.raises(error, match=f"^{function}: {message}"):
            getattr(rbfmu, function)(*args, **keywords)


@compiled_only
def test_no_out_may_be_given_as_none():
    """So the signature says, also where there are several results."""
    for k, found in enumerate(rbfmu.axis_angle_from_quaternion(Q, out=None)):
        np.testing.assert_array_equal(found, rbfmu.axis_angle_from_quaternion(Q)[k])
    assert rbfmu.free_rotation([1, 2, 3], Q[0], V[0], t=1.0, out=None)[0].shape == (4,)
    assert (rbfmu.rotate(Q, V, out=None) == rbfmu.rotate(Q, V)).all()


@compiled_only
def test_out_may_have_further_leading_axes():
    out = np.empty((2, 100, 3))
    assert (rbfmu.rotate(Q, V[0], out=out) == rbfmu.rotate(Q, V[0])).all()
    with pytest.raises(ValueError, match=r"rotate: casting"):
        rbfmu.rotate(Q, V[0], out=out, casting="bold")


@pytest.mark.parametrize("name", [*ARRAY_FUNCTIONS, "check_inertia", "inertia_of_points"])
def test_array_functions_go_to_other_processes(name):
    function = getattr(rbfmu, name)
    assert pickle.loads(pickle.dumps(function)) is function


@pytest.mark.slow
def test_type_checkers_know_the_names_and_no_others(tmp_path):
    program = tmp_path / "uses.py"
    known = [f"{m.__name__}.{name}" for m in (rbfmu, rbfmu_kernels) for name in m.__all__]
    program.write_text("\n".join(["import rbfmu, rbfmu_kernels", "rbfmu.roatte", "rbfmu_kernels.roatte", *known]))
    said, _, _ = pytest.importorskip("mypy.api").run(["--strict", f"--cache-dir={tmp_path}", str(program)])
    faults = [line.removeprefix(f"{program}:") for line in said.splitlines() if line.startswith(str(program))]
    assert [fault.split(":")[0] for fault in faults] == ["2", "3"]
    assert all('no attribute "roatte"' in fault for fault in faults)


def arguments_of(name):
    """Names and values: five items, the sequence by its name; the determinants of matrices are positive."""
    kernel = ARRAY_FUNCTIONS[name].__wrapped__
    shapes = core_shapes(kernel)[0]
    random = rng(75)
    sequences = {} if shapes.keys() == inspect.signature(kernel).parameters.keys() else {"seq": "ZXZ"}
    values = {key: random.uniform(0.5, 1.5, (5, *shape)) for key, shape in shapes.items()}
    matrices = {key: value + 2.0 * np.eye(value.shape[-1]) for key, value in values.items() if value.ndim == 3}
    return sequences | values | matrices


def numbers(results):
    return [r.tolist() for r in (results if isinstance(results, tuple) else (results,))]


@pytest.mark.parametrize("name", some_of([*ARRAY_FUNCTIONS], 2))
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


def test_an_attitude_may_be_given_by_name_without_its_frames():
    out = np.empty((100, 3))
    assert rbfmu.rotate(q_ab=Q, v_b=V, out=out) is out
    np.testing.assert_array_equal(out, rbfmu.rotate(Q, V))
    np.testing.assert_array_equal(rbfmu.euler_from_matrix("ZYX", R=R), rbfmu.euler_from_matrix("ZYX", R))
    np.testing.assert_array_equal(rbfmu.euler_from_quaternion(seq="zxz", q=Q), rbfmu.euler_from_quaternion("zxz", Q))
    np.testing.assert_array_equal(rbfmu.rotate(v_b=V, q=Q), rbfmu.rotate(Q, V))
    for twice in ({"q": Q}, {"q_ab": Q}):
        with pytest.raises(TypeError, match="rotate: q_ab is given twice, by position and by name"):
            rbfmu.rotate(Q, **twice)
    with pytest.raises(TypeError, match="rotate: unexpected keyword 'q'; arguments are q_ab, v_b, out"):
        rbfmu.rotate(q=Q, q_ab=Q, v_b=V)
    with pytest.raises(TypeError, match="compose_matrices: unexpected keyword 'q'"):
        rbfmu.compose_matrices(R, q=R)


@compiled_only
@pytest.mark.parametrize("rate", ["compose_omega", "rotvec_rate_a"])
def test_axes_are_those_of_numpy(rate):
    """Core axes first, also where a function watches for singular arguments."""
    arguments = {"compose_omega": (V, R, V[::-1]), "rotvec_rate_a": (V, V[::-1])}[rate]
    cores = [(0, 1) if a.ndim == 3 else (0,) for a in arguments] + [(0,)]
    turned = [np.moveaxis(a, 0, -1) for a in arguments]
    found = getattr(rbfmu, rate)(*turned, axes=cores)
    assert (getattr(rbfmu, rate)(*arguments) == found.T).all()
