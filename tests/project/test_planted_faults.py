"""`rbfmu stability --quick` finds faults planted in the product's methods; each run compiles all anew: minutes."""

from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.planted_faults import FAULTS, planted, stability


@pytest.mark.parametrize("name", FAULTS)
def test_text_to_be_changed_is_there_once(name: str) -> None:
    fault = FAULTS[name]
    text = (ROOT / fault.path).read_text()
    assert text.count(fault.right) == 1
    compile(text.replace(fault.right, fault.wrong), name, "exec")


def test_a_fault_is_planted_in_the_copy_alone(tmp_path: Path) -> None:
    fault = FAULTS["damping"]
    planted(fault, tmp_path)
    path = fault.path
    assert fault.wrong in (tmp_path / path).read_text()
    assert fault.wrong not in (ROOT / path).read_text()


@pytest.mark.slow
def test_without_a_fault_all_findings_hold() -> None:
    assert stability(None, "--quick") == (0, [])


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_fault_is_found(name: str) -> None:
    status, failed = stability(FAULTS[name], "--quick")
    print(f"{name}: {failed[0] if failed else 'not found'}, {len(failed)} fail")
    assert status in (1, 2)
    assert failed
