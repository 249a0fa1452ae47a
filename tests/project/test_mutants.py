"""Mutants are one change of a line each of all that is shipped; planted faults are found; covering sets cover."""

import ast
import itertools
from pathlib import Path

import pytest

from tests.support import mutants
from tests.support.covering import covering, some_of
from tests.support.paths import ROOT
from tests.support.planted_faults import FAULTS, planted, stability


@pytest.mark.thorough
def test_mutants_of_a_seed_are_one_change_of_a_line_each_in_every_package() -> None:
    found = mutants.drawn(3, 24)
    assert found == mutants.drawn(3, 24)
    assert {mutants.package_of(mutant.path) for mutant in found} == set(mutants.PACKAGES)
    for mutant in found:
        text = (ROOT / mutant.path).read_text()
        changed = mutant.planted(text)
        differing = [a != b for a, b in zip(text.split("\n"), changed.split("\n"), strict=True)]
        assert sum(differing) == 1, mutant
        if mutant.path.endswith(".py"):
            assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(text)), mutant


def test_what_a_copy_of_the_tree_changes_is_there() -> None:
    from rbfmu_kernels.compile import code_cache

    assert (ROOT / mutants.STAMPING).samefile(code_cache.__file__)
    assert f"def {code_cache.stamp_of.__name__}(function" in mutants.STAMP_OF_IMPORTS
    for name in mutants.SEE_ANY_CHANGE:
        path, test = name.split("::")
        assert f"def {test}(" in (ROOT / path).read_text(), name


def test_a_covering_set_has_each_value_of_each_axis() -> None:
    cases = list(itertools.product(range(5), range(3), range(2)))
    kept = covering(cases, "it")
    assert len(kept) == 5
    for axis, values in enumerate((5, 3, 2)):
        assert {cases[k][axis] for k in kept} == set(range(values))


def test_some_of_an_axis_stay_and_the_rest_are_thorough() -> None:
    found = some_of("abcdefgh", 3)
    marked = [value for value in found if not isinstance(value, str)]
    assert len(marked) == 5
    assert {mark.name for value in marked for mark in value.marks} == {"thorough"}
    assert sorted([value.values[0] for value in marked] + [v for v in found if isinstance(v, str)]) == list("abcdefgh")


# Planted faults


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
