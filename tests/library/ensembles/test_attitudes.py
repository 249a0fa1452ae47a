"""Means of attitudes and angles against those of all members, whatever their signs, turns and chunks."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rbfmu import run_ensemble
from rbfmu.ensembles.attitudes import around, moments_of
from rbfmu.ensembles.statistics import Statistics, keys_of, sample_of, summary_of
from rbfmu.ensembles.variables import Columns
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import OUTPUT

ATTITUDES = Columns((OUTPUT["quaternion"], OUTPUT["rpy"]))
TIMES = 3


def members(count, spread, seed=5, flips=True):
    """Rows (m, n, 7) of attitudes about one of each time, of either sign, and of their angles."""
    rng = np.random.default_rng(seed)
    middle = Rotation.random(TIMES, rng)
    turns = rng.normal(size=(count, TIMES, 3)) * spread * np.array([1.0, 0.5, 2.0])
    found = [[middle[t] * Rotation.from_rotvec(turns[i, t]) for t in range(TIMES)] for i in range(count)]
    q = np.array([[one.as_quat(scalar_first=True) for one in row] for row in found])
    rpy = np.array([[one.as_euler("ZYX")[::-1] for one in row] for row in found])
    if flips:
        q *= rng.choice([-1.0, 1.0], size=(count, TIMES, 1))
    return np.concatenate([q, rpy], axis=2)


def summed(rows, size, share=1.0):
    found = Statistics.none(TIMES, ATTITUDES, 256)
    for chunk, first in enumerate(range(0, len(rows), size)):
        part = rows[first : first + size]
        good = np.arange(len(part))
        sample = sample_of(part, good, first, ATTITUDES, share)
        found.add(summary_of(part, good, ATTITUDES, 256, chunk)._replace(sample=sample), ATTITUDES.pairs)
    return found


def moments(found, name):
    matrix = ATTITUDES.matrices(found.products)[name]
    return moments_of(name, found.count, found.mean[:, ATTITUDES.summed[name]], matrix)


def same_attitudes(a, b):
    return np.minimum(np.abs(a - b).max(axis=1), np.abs(a + b).max(axis=1))


@pytest.mark.parametrize("spread", [1e-9, 1e-3, 0.3, 1.0])
@pytest.mark.parametrize("size", [7, 64, 200])
def test_the_mean_attitude_is_that_of_all_members(spread, size):
    rows = members(200, spread)
    mean, covariance = moments(summed(rows, size), "quaternion")
    for t in range(TIMES):
        q = rows[:, t, :4]
        wanted = Rotation.from_quat(q, scalar_first=True).mean()
        assert same_attitudes(mean[[t]], wanted.as_quat(scalar_first=True)[None])[0] < 1e-13
        relative = (wanted.inv() * Rotation.from_quat(q, scalar_first=True)).as_quat(scalar_first=True)
        twice = 2.0 * relative[:, 1:]
        twice = np.where(relative[:, :1] < 0.0, -twice, twice)
        assert covariance[t] == pytest.approx(twice.T @ twice / 199.0, rel=1e-9, abs=1e-9 * spread**2 + 1e-15)


def test_small_turns_keep_their_digits_where_members_have_one_sign():
    rows = members(200, 1e-7, flips=False)
    middle = rows[0, :, :4]
    _, covariance = moments(summed(rows, 50), "quaternion")
    for t in range(TIMES):
        first = Rotation.from_quat(middle[t], scalar_first=True)
        turns = (first.inv() * Rotation.from_quat(rows[:, t, :4], scalar_first=True)).as_rotvec()
        assert covariance[t] == pytest.approx(np.cov(turns.T), rel=1e-6, abs=1e-20)


def test_the_sign_of_a_mean_attitude_does_not_jump():
    turn = np.linspace(0.0, 4.0 * np.pi, 40)
    q = np.array([np.cos(0.5 * turn), 0.0 * turn, 0.0 * turn, np.sin(0.5 * turn)]).T
    mean, _ = moments_of("quaternion", 2, q, np.zeros((40, 4, 4)))
    assert mean == pytest.approx(q, abs=1e-14)


@pytest.mark.parametrize("middle", [0.3, np.pi, -np.pi, 3.1])
def test_angles_near_a_half_turn_have_their_direction(middle):
    rng = np.random.default_rng(8)
    deviations = 0.2 * rng.normal(size=(900, TIMES, 3))
    rows = members(900, 0.1)
    rows[:, :, 4:] = np.angle(np.exp(1j * (middle + deviations)))
    found = summed(rows, 128)
    mean, covariance = moments(found, "rpy")
    wanted = np.angle(np.exp(1j * rows[:, :, 4:]).mean(axis=0))
    assert np.abs(np.exp(1j * mean) - np.exp(1j * wanted)).max() < 1e-14
    sines = np.sin(rows[:, :, 4:] - wanted)
    for t in range(TIMES):
        assert covariance[t] == pytest.approx(sines[:, t].T @ sines[:, t] / 899.0, rel=1e-11, abs=1e-14)
    parts = np.array([0.05, 0.5, 0.95])
    quantiles, error = found.quantiles(parts, mean)
    ranks = (around(mean, rows[:, :, 4:])[:, None] < quantiles[None]).mean(axis=0)
    assert np.abs(ranks - parts[:, None, None]).max() <= 2.0 * error + 1.0 / 900.0  # beyond a half turn too
    assert np.abs(quantiles - mean).max() < 1.0


def test_a_sample_of_more_runs_is_a_part_of_that_of_fewer_and_members_are_taken_alike():
    keys = keys_of(np.arange(200_000))
    assert len(np.unique(keys)) == len(keys)
    published = (0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F)  # splitmix64 from the state 0 on
    assert keys[:3].tolist() == [x * 2.0**-64 for x in published]  # so that kept stores can be continued
    assert 0.0 <= keys.min() < keys.max() < 1.0
    counts = np.histogram2d(keys, np.arange(len(keys)) % 16, bins=(10, 16))[0]
    assert np.abs(counts / 1250.0 - 1.0).max() < 0.15
    rows = members(300, 0.2)
    few, many = summed(rows, 64, 0.5).sample(0.25), summed(rows, 50, 0.25).sample(0.25)
    assert few.tobytes() == many.tobytes()
    assert 40 < len(many) < 110


SCENE = {
    "body": {"mass": 2.0, "inertia": [1.0, 1.2, 1.4]}, "loads": {"gravity_a": [0.0] * 3},
    "initial": {"attitude": {"rotvec": [0.0, 0.0, 3.1]}, "omega_b": [0.1, 0.2, 0.6]},
    "outputs": {"quantities": ["quaternion", "rpy"]}, "run": {"stop": 4.0, "step": 0.5},
}  # fmt: skip
VARY = {"initial.attitude": {"rotvec_deg": 10.0}, "initial.omega_b": {"normal": [[0.1, 0.2, 0.6], [0.05] * 3]}}


def scene_of(keep, runs=3_000):
    return Scene.from_dict(SCENE | {"ensemble": {"runs": runs, "seed": 3, "keep": keep, "vary": VARY}}, "turning")


def test_statistics_are_those_of_the_kept_runs():
    every, few = (run_ensemble(scene_of([*keep, "statistics"]), progress=False) for keep in (["all"], []))
    q = every.all["quaternion"]
    for k in range(len(every.time)):
        sums = np.einsum("ij,ik->jk", q[:, k], q[:, k])
        wanted = np.linalg.eigh(sums)[1][:, -1]
        assert same_attitudes(every.mean["quaternion"][[k]], wanted[None])[0] < 1e-13
        angles = 2.0 * np.arccos(np.minimum(np.abs(q[:, k] @ wanted), 1.0))
        quantiles = np.quantile(angles, every.probabilities, method="hazen")
        assert every.quantiles["quaternion"][:, k] == pytest.approx(quantiles, abs=1e-7)
        ranks = np.searchsorted(np.sort(angles), few.quantiles["quaternion"][:, k]) / 3_000
        assert np.abs(ranks - few.probabilities).max() < 4.0 * 0.5 / np.sqrt(1024.0)
    for name in ("quaternion", "rpy"):
        assert few.mean[name] == pytest.approx(every.mean[name], abs=1e-13)
        assert few.std[name] == pytest.approx(every.std[name], rel=1e-9)
    angles, parts = around(every.mean["rpy"], every.all["rpy"]), every.probabilities
    wanted = np.quantile(angles, parts, axis=0, method="hazen")
    assert every.quantiles["rpy"] == pytest.approx(wanted, abs=1e-14)
    ranks = (angles[:, None, 1:] < few.quantiles["rpy"][None, :, 1:]).mean(axis=0)
    assert np.abs(ranks - parts[:, None, None]).max() <= 2.0 * few.rank_error + 1e-3  # beyond a half turn too


def test_bits_are_the_same_for_any_workers_and_after_more_runs(tmp_path):
    one = run_ensemble(scene_of(["final", "statistics"]), executor=1, progress=False)
    store = tmp_path / "store.npz"
    run_ensemble(scene_of(["final", "statistics"], 1_500), store, executor=3, progress=False)
    more = run_ensemble(scene_of(["final", "statistics"]), store, executor=2, resume=True, progress=False)
    for name in ("quaternion", "rpy"):
        for kept in ("mean", "std", "covariance", "quantiles"):
            assert getattr(one, kept)[name].tobytes() == getattr(more, kept)[name].tobytes(), (name, kept)
