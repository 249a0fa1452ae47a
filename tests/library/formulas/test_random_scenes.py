"""Scenes with formulas drawn by a grammar, see `tests.support.scenes.random_formulas`: accuracy, corners, ends."""

import pytest

from tests.support.scenes.random_formulas import Drawn, at_ends, campaign, restored_beside_corners, tried


def beyond(error):
    """Whether an error over the accuracy is silently beyond it."""
    return not isinstance(error, str) and error > 1.0


@pytest.mark.parametrize("seed", [*range(0, 10, 2), 1])
def test_random_formulas_meet_the_accuracy_or_are_refused(seed):
    assert not beyond(tried(seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1000, 1300))
def test_300_random_formulas_meet_the_accuracy_in_all_settings_or_are_refused(seed):
    found = [f"{setting}: {error}" for setting, error in campaign(seed) if beyond(error)]
    assert not found, f"{found}\n{Drawn(seed).tables(cornered=bool(seed % 2))}"


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [2, 5, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in range(6, 23))])
def test_a_state_restored_beside_a_corner_goes_on_with_the_same_bits(seed):
    restored, wrong = restored_beside_corners(seed)
    assert restored
    assert not wrong, f"{wrong}\n{Drawn(seed).tables(cornered=True)}"


@pytest.mark.thorough
@pytest.mark.parametrize(
    "seed", [0, 7039, 31201, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in range(1, 21))]
)
def test_a_plan_holds_at_both_ends_of_the_range_of_a_listed_constant(seed):
    assert not [error for error in at_ends(seed) if beyond(error)]
