"""Laws of the small kernels that others are made of, and a guard: every public kernel is named in a test."""

import re

import numpy as np
import pytest

import rbfmu_kernels as k
from tests.support.paths import ROOT
from tests.support.references import exact
from tests.support.references.hard_cases import rng

KERNELS = [name for name in k.__all__ if callable(getattr(k, name)) and not name[0].isupper()]


def test_every_public_kernel_is_named_in_a_test():
    """Beside the tables of laws, of which `test_array_functions` has the guard."""
    named = {word for path in (ROOT / "tests").rglob("test_*.py") for word in re.findall(r"\w+", path.read_text())}
    assert set(KERNELS) - named == set()


@pytest.mark.parametrize(
    ("add_scaled", "shape"), [(k.add_scaled, (3,)), (k.add_scaled_quaternion, (4,)), (k.add_scaled_matrix, (3, 3))]
)
def test_add_scaled_is_off_by_one_rounding_each_of_product_and_sum(add_scaled, shape):
    for a, b, s in zip(
        rng(91).normal(size=(200, *shape)), rng(92).normal(size=(200, *shape)), rng(93).normal(size=200), strict=True
    ):
        a, b, s = exact.rounded(a.tolist()), exact.rounded(b.tolist()), float(s)
        sums = zip(exact.flat(add_scaled(a, s, b)), exact.flat(a), exact.flat(b), strict=True)
        for total, x, y in sums:
            truth = exact.mp.mpf(x) + exact.mp.mpf(s) * exact.mp.mpf(y)
            assert exact.error(total, truth, abs(x) + 2 * abs(s * y)) <= 0.5


def test_a_symmetric_matrix_times_its_adjugate_is_its_determinant():
    for A in rng(94).normal(size=(100, 3, 3)):
        M = (A + A.T).tolist()
        adjugate = exact.exact(k.adjugate_symmetric(exact.rounded(M)))
        product = exact.product(exact.exact(M), adjugate)
        size = np.linalg.norm(M) ** 3
        expected = [[exact.mp.det(exact.mp.matrix(M)) * (i == j) for j in range(3)] for i in range(3)]
        assert (
            max(abs(p - e) for p, e in zip(exact.flat(product), exact.flat(expected), strict=True))
            <= 2 * exact.EPS * size
        )
