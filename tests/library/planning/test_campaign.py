"""Random scenes, planned and driven as by an importer: none silently wrong, none refused that plain series meet.

Each test's name says its first seed; a failure prints scenes that can be pasted. By hand: quadruple/campaign.py.
"""

import pytest

from tests.support.quadruple import reference
from tests.support.quadruple.campaign import FAILED, settings_from, table
from tests.support.quadruple.plans import line, planned

SETTINGS, BLOCKS = 100, 50

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(reference.library() is None, reason="no C compiler with quadruple precision"),
    pytest.mark.filterwarnings("ignore::rbfmu.planning.judge.PlanningWarning"),  # said, and no verdict on the answer
]


@pytest.mark.parametrize("seed", [1000 * block for block in range(BLOCKS)])
def test_none_is_silently_wrong_and_none_refused_without_need(seed):
    found = [finding for finding, _ in settings_from(seed, SETTINGS)]
    print(table(found))
    failures = [str(f) for f in found if f.verdict in FAILED]
    assert not failures, "\n\n".join(failures)


@pytest.mark.parametrize("seed", [100 * block for block in range(20)])
def test_every_plan_ends_and_what_is_refused_is_refused_with_a_key_and_truly(seed):
    """By hand, with the CPU time of each: quadruple/plans.py."""
    found = [one for number in range(seed, seed + 100) if (one := planned(number, number % 20 == 0))]
    assert found
    assert not [line(one) for one in found if one.verdict in FAILED]
