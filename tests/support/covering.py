"""Of a test with several axes of parameters, a set in which each value of each axis stands at least once.

A cross product costs the product of its axes and finds little more than such a set, which costs the longest of them.
The rest is `thorough`: `make slow` and CI run it; of what takes longest CI runs a part. A test by name (`pytest -k`)
has all of its cases.
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
DEAREST = {
    "tests/fmu/native/test_native_fmu.py::test_fmu_is_the_kernels_over_10000_steps_before_and_after_a_restore": 6,
    "tests/fmu/test_conformance.py::test_any_calls_are_answered_rightly": 1,
    "tests/kernels/models/test_changing_inputs.py::test_loads_change_within_a_step_as_their_derivatives_say": 4,
    "tests/kernels/models/test_undamped_pendulum.py::test_a_pendulum_is_that_of_40_digits": 5,
    "tests/library/ensembles/test_lanes.py::test_formulas": 1,
    "tests/library/ensembles/test_lanes.py::test_shipped_scenes": 1,
    "tests/library/formulas/test_gallery_scenes.py::"
    "test_a_scene_is_as_accurate_as_asked_by_equations_written_by_hand": 2,
    "tests/library/formulas/test_gallery_scenes.py::test_its_fmu_has_the_bits_of_its_kernels": 2,
    "tests/library/formulas/test_random_scenes.py::test_a_state_restored_beside_a_corner_goes_on_with_the_same_bits": 5,
    "tests/library/formulas/test_random_scenes.py::test_a_plan_holds_at_both_ends_of_the_range_of_a_listed_constant": 6,
    "tests/library/formulas/test_scenes.py::test_other_steps_meet_the_accuracy_too": 6,
    "tests/library/models/test_registry.py::test_the_registry_takes_what_the_kernels_take_at_borders": 10,
    "tests/project/test_gallery.py::test_a_scene_is_as_accurate_as_asked_by_40_digits": 5,
}
"""Tests of which a case takes seconds, and how many of them CI runs besides; `make slow` runs all."""


def mark_what_a_covering_set_leaves(items: Sequence[pytest.Item]) -> None:
    """Mark cases that no covering set has as thorough, and most of those of the dearest tests as slow.

    What is marked as thorough or slow by hand has no covering set.
    """
    cases, dearest = defaultdict(list), defaultdict(list)
    for item in items:
        name, slow = item.nodeid.partition("[")[0], item.get_closest_marker("slow")
        if isinstance(item, pytest.Function) and hasattr(item, "callspec") and not slow:
            if not item.get_closest_marker("thorough"):
                cases[name].append(item)
            if name in DEAREST:
                dearest[name].append(item)
    for name, of_one_test in cases.items():
        values = [_values(item) for item in of_one_test]
        if len(values[0]) > 1 or name.startswith(DEAR):
            kept = covering(values, name) if len(values[0]) > 1 else drawn(len(values), name)
            for k, item in enumerate(of_one_test):
                if k not in kept:
                    item.add_marker(pytest.mark.thorough)
    for name, of_one_test in dearest.items():
        rest = [item for item in of_one_test if item.get_closest_marker("thorough")]
        kept = drawn(len(rest), name, DEAREST[name])
        for k, item in enumerate(rest):
            if k not in kept:
                item.add_marker(pytest.mark.slow)


def _values(item: pytest.Function) -> tuple[tuple[int, ...], ...]:
    """Return which value of each axis a case has; names that are parametrised together are one axis."""
    values = {name: id(value) for name, value in item.callspec.params.items()}
    together = [_names(mark.args[0]) for mark in item.iter_markers("parametrize")]
    alone = [[name] for name in values if not any(name in names for names in together)]
    return tuple(tuple(values[name] for name in names) for names in [*together, *alone])


def _names(said: str | Sequence[str]) -> Sequence[str]:
    return said.replace(" ", "").split(",") if isinstance(said, str) else said


def drawn(number: int, name: str, most: int = MOST) -> set[int]:
    """Return which of a single axis' values to take."""
    return set(random.Random(f"{SEED} {name}").sample(range(number), min(number, most)))


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
