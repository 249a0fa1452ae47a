"""What 0.1.0 answered wrongly without a word, or refused without need, is right or refused with a reason."""

import math

import pytest

from rbfmu.scene.tables import Run
from rbfmu_kernels.integrators.splitting import is_symmetric_top
from rbfmu_kernels.mechanics.inertia import diagonal, inverse_inertia
from tests.support.covering import some_of
from tests.support.quadruple import reference
from tests.support.quadruple.verdicts import judged
from tests.support.scenes.mended_scenes import CASES

SLOW = (8, 10, 12)
"""Items whose reference takes long."""


def item(case):
    marks = [pytest.mark.slow] if case.item in SLOW else []
    return pytest.param(case, id=f"{case.item}: {case.name}", marks=marks)


@pytest.mark.thorough
@pytest.mark.skipif(reference.library() is None, reason="no C compiler with quadruple precision")
@pytest.mark.parametrize("case", some_of([item(case) for case in CASES], 10))
def test_what_was_wrong(case):
    verdict = judged(case)
    assert verdict.right, f"{verdict.text} ({verdict.model}); 0.1.0: {case.said}"


@pytest.mark.parametrize("start", [0.0, 1e3, 1e9, 1.7e9])
@pytest.mark.parametrize("step", [0.3, 0.25, 1.0])
def test_a_run_ends_at_its_stop(start, step):
    grid = Run(start=start, stop=start + 1.0, step=step).grid()
    assert grid[-1] == start + 1.0
    assert len(grid) == math.ceil(1.0 / step) + 1
    assert max(grid[1:] - grid[:-1]) <= step + 2.0 * math.ulp(start)


@pytest.mark.parametrize("scale", [1e-300, 1e-165, 1e-100, 1.0, 1e100, 1e165, 1e300])
def test_symmetry_and_inverse_at_any_scale(scale):
    assert not is_symmetric_top(diagonal((scale, 2.0 * scale, 2.5 * scale)))
    assert is_symmetric_top(diagonal((scale, scale, 0.5 * scale)))
    inverse = inverse_inertia(diagonal((scale, 2.0 * scale, 2.5 * scale)))
    assert [inverse[k][k] * scale for k in range(3)] == pytest.approx([1.0, 0.5, 0.4], rel=4e-16)
