"""What array functions warn of, and what threads change in it: nothing, nor in the numbers."""

import math
import subprocess
import sys
import warnings

import numpy as np
import pytest

import rbfmu
from tests.support.array_arguments import Q, R, V, compiled_only


def test_nan_stays_where_it_is_and_nothing_warns():
    spoiled = Q.copy()
    spoiled[3, 2] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for function in (rbfmu.normalize, rbfmu.matrix_from_quaternion, rbfmu.rotvec_from_quaternion):
            bad = np.isnan(function(spoiled)).reshape(100, -1).any(axis=1)
            assert np.flatnonzero(bad).tolist() == [3]


@pytest.mark.parametrize("to", ["matrix", "rotvec", "axis_angle", "gibbs", "mrp", "euler ZYX", "euler zxz"])
def test_the_zero_quaternion_gives_nan_and_nothing_warns(to):
    """Not the identity, as which Euler angles and an axis with its angle had it, nor half a turn."""
    name, *seq = to.split()
    function = getattr(rbfmu, f"{name}_from_quaternion")
    spoiled = Q.copy()
    spoiled[60] = 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, expected = function(*seq, spoiled), function(*seq, Q)
    for ours, theirs in zip(*(r if isinstance(r, tuple) else (r,) for r in (found, expected)), strict=True):
        assert np.isnan(ours[60]).all()
        assert (np.delete(ours, 60, axis=0) == np.delete(theirs, 60, axis=0)).all()


@pytest.mark.parametrize(("rate", "omega"), [("euler_rate_a", V), ("euler_rate_b", V[0])])
def test_singular_euler_rates_warn_of_gimbal_lock(rate, omega):
    angles = np.full((100, 3), 0.3)
    function = getattr(rbfmu, rate)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        expected = function("ZYX", angles, omega)
    angles[60, 1] = math.pi / 2
    said = r"are in gimbal lock \(\|det E\| < 4 eps: the middle angle is -90 or 90"
    text = f"{rate}: some of these Euler angles ZYX {said}"
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


def test_numpy_s_error_state_rules_the_warning():
    with np.errstate(divide="ignore"), warnings.catch_warnings():
        warnings.simplefilter("error")
        rbfmu.euler_rate_a("ZYX", [0.0, math.pi / 2, 0.0], V[0])
    with np.errstate(divide="raise"), pytest.raises(FloatingPointError, match="gimbal lock"):
        rbfmu.euler_rate_a("ZYX", [0.0, math.pi / 2, 0.0], V[0])


MIRROR, ZEROS = np.diag([1.0, 1.0, -1.0]), np.zeros(3)
AXES, M, SIZES = Q[:, 1:], np.linspace(1.0, 2.0, 100), np.abs(V)
NOT_ROTATIONS, NEGATIVE = r"no rotations \(det <= 0, as of a reflection\), which gives NaN", "negative, which gives NaN"
WITHOUT_ANSWER = [  # a function, its arguments, which of them is made impossible for one item, by what; what is said
    *((name, (R,), 0, MIRROR, NOT_ROTATIONS) for name in ("quaternion_from_matrix", "rotvec_from_matrix")),
    ("axis_angle_from_matrix", (R,), 0, -np.eye(3), NOT_ROTATIONS),
    ("euler_from_matrix", ("ZYX", R), 1, MIRROR, NOT_ROTATIONS),
    *((f"{name}_from_axis_angle", (AXES, M), 0, ZEROS, "no direction") for name in ("quaternion", "matrix")),
    ("quaternion_from_axis_angle", (AXES, M), 0, np.full(3, 1e200), "no direction"),
    *((f"{name}_inertia", (M, M), k, -1.0, NEGATIVE) for name in ("beam", "sphere") for k in (0, 1)),
    *((f"{name}_inertia", (M, SIZES), 1, np.array([1.0, 1.0, -1.0]), NEGATIVE) for name in ("box", "ellipsoid")),
    *((f"{name}_inertia", (M, SIZES), 0, -1.0, NEGATIVE) for name in ("box", "ellipsoid")),
    *(("cylinder_inertia", (M, M, M), k, -1.0, NEGATIVE) for k in (0, 1, 2)),
]


def first_of(results):
    return results[0] if isinstance(results, tuple) else results


@pytest.mark.parametrize("row", WITHOUT_ANSWER, ids=lambda row: f"{row[0]}-{row[2]}")
def test_what_has_no_answer_is_nan_and_warns(row):
    name, arguments, k, impossible, said = row
    function, spoiled = getattr(rbfmu, name), [np.array(a) if np.ndim(a) else a for a in arguments]
    spoiled[k][60] = impossible
    expected = first_of(function(*arguments))
    with pytest.warns(RuntimeWarning, match=f"^{name}: .*{said}") as record:
        found = first_of(function(*spoiled))
    assert [w.filename for w in record] == [__file__]
    assert np.isnan(found[60]).any()
    assert (np.delete(found, 60, axis=0) == np.delete(expected, 60, axis=0)).all()
    spoiled[k][60] = np.nan
    function(*spoiled)  # without a warning, which would be an error here


@pytest.mark.parametrize(("seq", "pole"), [("ZYX", [0.3, math.pi / 2, 0.2]), ("zxz", [0.3, 0.0, 0.2])])
def test_euler_angles_of_a_pole_warn(seq, pole):
    angles = np.tile([0.3, 1.0, 0.2], (100, 1))
    for of, to in ((rbfmu.euler_from_quaternion, "quaternion"), (rbfmu.euler_from_matrix, "matrix")):
        rotations = getattr(rbfmu, f"{to}_from_euler")(seq, angles)
        expected = of(seq, rotations)
        rotations[60] = getattr(rbfmu, f"{to}_from_euler")(seq, pole)
        said = f"{of.__name__}: some of these rotations are at a pole of {seq}"
        with pytest.warns(RuntimeWarning, match=said) as record:
            found = of(seq, rotations)
        assert [w.filename for w in record] == [__file__]
        assert found[60, 2] == 0.0
        assert (np.delete(found, 60, axis=0) == np.delete(expected, 60, axis=0)).all()


@pytest.fixture
def two_threads(monkeypatch):
    monkeypatch.setattr(rbfmu.arrays.from_kernel, "CHUNK", 16)
    monkeypatch.setattr(rbfmu.arrays.from_kernel, "THRESHOLD", 64)
    rbfmu.set_threads(2)
    yield
    rbfmu.set_threads(1)


CALLS = [
    lambda: rbfmu.rotate(Q, V), lambda: rbfmu.rotate(Q[0], V), lambda: rbfmu.transform(R[:4, np.newaxis], V),
    lambda: rbfmu.slerp(Q, Q[::-1], 0.3), lambda: rbfmu.axis_angle_from_quaternion(Q)[1],
    lambda: rbfmu.euler_from_quaternion("ZYX", Q.reshape(2, 50, 4)), lambda: rbfmu.rotate(Q, V, out=np.empty((100, 3))),
    lambda: rbfmu.rotate(Q[3], V[3]),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(CALLS)))
def test_threads_give_the_same_bits(number, two_threads):
    threaded = CALLS[number]()
    rbfmu.set_threads(1)
    alone = CALLS[number]()
    assert threaded.shape == alone.shape
    assert (threaded == alone).all()


OVERLAPS = {"reversed": (np.s_[99::-1], np.s_[:100]), "one row on": (np.s_[:100], np.s_[1:]), "same": (np.s_[1:],) * 2}


@pytest.mark.parametrize("name", OVERLAPS)
def test_threads_write_over_an_argument_as_over_a_copy(name, two_threads):
    """Chunk by chunk, rows would be made of rows that are results already."""
    rows = np.random.default_rng(3).normal(size=(101, 3))
    argument, out = (rows[part] for part in OVERLAPS[name])
    expected = rbfmu.rotate(Q, argument.copy())
    assert (rbfmu.rotate(Q, argument, out=out) == expected).all()


def test_another_number_of_threads_during_a_call_changes_nothing(two_threads, monkeypatch):
    """Otherwise the call has no threads any more: RuntimeError."""
    expected, copied = rbfmu.rotate(Q, V), rbfmu.arrays.from_kernel.copy_context

    def meanwhile():
        rbfmu.set_threads(1)
        return copied()

    monkeypatch.setattr(rbfmu.arrays.from_kernel, "copy_context", meanwhile)
    assert (rbfmu.rotate(Q, V) == expected).all()


def test_threads_warn_and_raise_as_one_does(two_threads):
    angles = np.full((100, 3), math.pi / 2)
    with pytest.warns(RuntimeWarning, match="euler_rate_a") as record:
        rbfmu.euler_rate_a("ZYX", angles, V)
    assert [w.filename for w in record] == [__file__]
    with pytest.raises(ValueError, match="v_b must have trailing shape"):
        rbfmu.rotate(Q, V[:, :2])
    with pytest.raises(ValueError, match="do not broadcast"):
        rbfmu.rotate(Q, V[:99])
    with pytest.raises(TypeError, match="rotate: out must be an array, got "):
        rbfmu.rotate(Q, V, out=V.tolist())


@compiled_only
def test_threads_obey_the_caller_s_error_state(two_threads):
    with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
        rbfmu.euler_rate_a("ZYX", np.full((100, 3), math.pi / 2), V)


@pytest.mark.parametrize("wrong", [0, 1.5, 2.0, True, "2", None])
def test_threads_are_a_whole_number_of_at_least_one(wrong):
    with pytest.raises(ValueError, match=f"set_threads: n must be a whole number of at least 1, got {wrong!r}"):
        rbfmu.set_threads(wrong)


FORKED = """
import os, signal
import numpy as np
import rbfmu
from rbfmu.arrays import from_kernel

from_kernel.CHUNK, from_kernel.THRESHOLD = 16, 64
rbfmu.set_threads(2)
v_b = np.ones((100, 3))
rbfmu.rotate([1.0, 0.0, 0.0, 0.0], v_b)
child = os.fork()
if not child:
    signal.alarm(60)
    os._exit(int((rbfmu.rotate([1.0, 0.0, 0.0, 0.0], v_b) != v_b).any()))
print(os.waitpid(child, 0)[1])
"""


def test_a_forked_process_has_threads_of_its_own():
    """2026-11-30: it waited for those of its parent for ever, where `set_threads` had been called before."""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", FORKED], capture_output=True, text=True, check=True)
    assert done.stdout == "0\n"
