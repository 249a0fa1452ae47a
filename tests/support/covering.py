"""Of a test with several axes of parameters, a set in which each value of each axis stands at least once.

A cross product costs the product of its axes and finds little more than such a set, which costs the longest of them.
The rest is `thorough`: `make slow` and CI run it. A test by name (`pytest -k`) has all of its cases.
"""

import random
from collections import defaultdict
from collections.abc import Hashable, Sequence
from typing import Any

import pytest
from _pytest.mark import ParameterSet

SEED = 1
"""Another seed draws other sets; what each holds does not hang on which other tests there are."""


DEAR, MOST = (
    *(f"tests/kernels/{part}/" for part in ("exact", "integrators", "models")),
    *(f"tests/library/{part}/" for part in ("ensembles", "models", "planning", "studies")),
    *(f"tests/library/formulas/test_{part}" for part in (
        "gallery_scenes", "random_scenes", "scenes.py::test_a_load_of_the_scene", "scenes.py::test_scenes_meet")),
    "tests/fmu/", "tests/kernels/compile/test_tiered", "tests/project/test_gallery",
    "tests/kernels/rotations/test_euler_angles.py::test_error",
    "tests/project/test_figures.py::test_the_gallery_s_plans",
), 1  # fmt: skip
"""Tests that build, simulate or plan, and how many cases of one that has a single axis are taken."""


def mark_what_a_covering_set_leaves(items: Sequence[pytest.Item]) -> None:
    """Mark all cases of each test as thorough but those of its covering set; slow and thorough ones stand apart."""
    cases = defaultdict(list)
    for item in items:
        apart = item.get_closest_marker("slow") or item.get_closest_marker("thorough")
        if isinstance(item, pytest.Function) and hasattr(item, "callspec") and not apart:
            cases[item.nodeid.partition("[")[0]].append(item)
    for name, of_one_test in cases.items():
        values = [_values(item) for item in of_one_test]
        if len(values[0]) > 1 or name.startswith(DEAR):
            kept = covering(values, name) if len(values[0]) > 1 else drawn(len(values), name)
            for k, item in enumerate(of_one_test):
                if k not in kept:
                    item.add_marker(pytest.mark.thorough)


def _values(item: pytest.Function) -> tuple[tuple[int, ...], ...]:
    """Return which value of each axis a case has; names that are parametrised together are one axis."""
    values = {name: id(value) for name, value in item.callspec.params.items()}
    together = [_names(mark.args[0]) for mark in item.iter_markers("parametrize")]
    alone = [[name] for name in values if not any(name in names for names in together)]
    return tuple(tuple(values[name] for name in names) for names in [*together, *alone])


def _names(said: str | Sequence[str]) -> Sequence[str]:
    return said.replace(" ", "").split(",") if isinstance(said, str) else said


def drawn(number: int, name: str) -> set[int]:
    """Return which of a single axis' values to take."""
    return set(random.Random(f"{SEED} {name}").sample(range(number), min(number, MOST)))


def covering(cases: Sequence[tuple[Hashable, ...]], name: str) -> set[int]:
    """Return which cases to take so that each value of each axis is taken; ties are drawn by the test's name."""
    left = {(axis, value) for case in cases for axis, value in enumerate(case)}
    order = list(range(len(cases)))
    random.Random(f"{SEED} {name}").shuffle(order)
    kept = set()
    while left:
        best = max(order, key=lambda k: len(left.intersection(enumerate(cases[k]))))
        kept.add(best)
        left.difference_update(enumerate(cases[best]))
    return kept


def some_of(values: Sequence[object], count: int) -> list[object]:
    """Return the values of an axis that alone is long, all but a few of them, which are drawn, as thorough cases."""
    kept = random.Random(f"{SEED} {len(values)}").sample(range(len(values)), count)
    return [v if k in kept else _as_thorough(v) for k, v in enumerate(values)]


def _as_thorough(value: Any) -> ParameterSet:
    """Return a value of an axis, with an id and marks or without, as a thorough case."""
    given = value if isinstance(value, ParameterSet) else pytest.param(value)
    return pytest.param(*given.values, id=given.id, marks=[*given.marks, pytest.mark.thorough])
