"""Random scenes, planned and driven as by an importer: none silently wrong, none refused that plain series meet.

Each test's name says its first seed; a failure prints scenes that can be pasted. By hand: quadruple/campaign.py.
"""

import pytest

from tests.support.quadruple import reference
from tests.support.quadruple.campaign import FAILED, settings_from, table

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
