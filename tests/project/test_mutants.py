"""Mutants are drawn from all that is shipped, each is one change of a line; covering sets cover."""

import ast
import itertools

import pytest

from tests.support import mutants
from tests.support.covering import covering, some_of
from tests.support.paths import ROOT


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
