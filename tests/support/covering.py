"""Of a test with several axes of parameters, a set in which each value of each axis stands at least once.

A cross product costs the product of its axes and finds little more than such a set, which costs the longest of them.
The rest is `thorough`: `make slow` runs it, and CI a part. A test by name (`pytest -k`) has all of its cases.
"""

import random
from collections import defaultdict
from collections.abc import Collection, Hashable, Sequence
from typing import Any

import pytest
from _pytest.mark import ParameterSet

SEED = 1
"""Another seed draws other sets; what each holds does not hang on which other tests there are."""


DEAR = (
    *(f"tests/kernels/{part}/" for part in ("exact", "integrators", "models")),
    *(f"tests/library/{part}/" for part in ("ensembles", "models", "planning", "studies")),
    *(f"tests/library/formulas/test_{part}" for part in (
        "gallery_scenes", "random_scenes", "scenes.py::test_a_load_of_the_scene", "scenes.py::test_scenes_meet")),
    "tests/fmu/", "tests/kernels/compile/test_tiered", "tests/project/test_gallery",
    "tests/kernels/rotations/test_euler_angles.py::test_error",
    "tests/project/test_figures.py::test_the_gallery_s_plans",
)  # fmt: skip
"""Tests that build, simulate or plan: of one that has a single axis a case is taken."""
CHEAP = (
    *(f"tests/kernels/integrators/test_{part}.py" for part in ("dense_output", "free_series")),
    *(f"tests/kernels/models/test_{part}.py" for part in ("model_shell", "outputs", "undamped_pendulum")),
    *(f"tests/library/planning/test_no_more_than_needed.py::test_{part}" for part in ("thrust_that", "the_angular")),
    *(f"tests/library/studies/test_{part}.py" for part in ("chart_files", "own_method")),
    "tests/fmu/test_demo.py", "tests/fmu/test_model_description.py",
    *(f"tests/fmu/python/test_fmu_traps.py::test_{part}" for part in ("refusal", "a_start_time")),
)  # fmt: skip
"""Of these, files and tests, all cases take less than half a second together: one case a test overlooked faults for
nothing."""
ALIKE = (
    *DEAR, "tests/library/formulas/",
    *(f"tests/library/arrays/test_array_functions.py::test_{part}" for part in ("array", "kernels_take")),
)  # fmt: skip
"""Tests whose cases take long together: of those that a covering set leaves CI runs one each, `make slow` all."""
AROUND = (
    "tests/fmu/test_interop.py", "tests/library/ensembles/test_lanes.py", "tests/library/studies/",
    *(f"tests/project/command_line/test_{part}.py" for part in ("extras", "interrupt", "without_posix")),
    *(f"tests/project/test_{part}.py" for part in ("benchmarks", "examples", "pages")),
)  # fmt: skip
"""Tests of what stands around the product, and of its dearest compilations, of which CI runs no thorough one."""


def mark_what_a_covering_set_leaves(items: Sequence[pytest.Item]) -> None:
    """Mark cases that no covering set has as thorough, and those of them that are too many for CI as slow.

    What is thorough by hand has its covering set there; what is slow by hand has none.
    """
    cases, alike = defaultdict(list), defaultdict(list)
    for item in items:
        name, slow = item.nodeid.partition("[")[0], item.get_closest_marker("slow")
        if isinstance(item, pytest.Function) and hasattr(item, "callspec") and not slow and not name.startswith(CHEAP):
            if not item.get_closest_marker("thorough"):
                cases[name].append(item)
            if name.startswith(ALIKE):
                alike[name].append(item)
    for name, of_one_test in cases.items():
        if _has_axes(of_one_test) or name.startswith(DEAR):
            _mark_all_but(_kept(of_one_test, name), of_one_test, pytest.mark.thorough)
    for item in items:
        if item.nodeid.startswith(AROUND) and item.get_closest_marker("thorough"):
            item.add_marker(pytest.mark.slow)
    for name, of_one_test in alike.items():
        rest = [item for item in of_one_test if item.get_closest_marker("thorough")]
        _mark_all_but(drawn(len(rest), name) if name in cases else _kept(rest, name), rest, pytest.mark.slow)


def _has_axes(cases: Sequence[pytest.Function]) -> bool:
    return len(_values(cases[0])) > 1


def _kept(cases: Sequence[pytest.Function], name: str) -> set[int]:
    """Return which cases of a test to take: of one with a single axis one."""
    return covering([_values(case) for case in cases], name) if _has_axes(cases) else drawn(len(cases), name)


def _mark_all_but(kept: Collection[int], items: Sequence[pytest.Item], mark: pytest.MarkDecorator) -> None:
    for k, item in enumerate(items):
        if k not in kept:
            item.add_marker(mark)


def _values(item: pytest.Function) -> tuple[tuple[int, ...], ...]:
    """Return which value of each axis a case has; names that are parametrised together are one axis."""
    values = {name: id(value) for name, value in item.callspec.params.items()}
    together = [_names(mark.args[0]) for mark in item.iter_markers("parametrize")]
    alone = [[name] for name in values if not any(name in names for names in together)]
    return tuple(tuple(values[name] for name in names) for names in [*together, *alone])


def _names(said: str | Sequence[str]) -> Sequence[str]:
    return said.replace(" ", "").split(",") if isinstance(said, str) else said


def drawn(number: int, name: str) -> set[int]:
    """Return which of so many cases to take: one."""
    return set(random.Random(f"{SEED} {name}").sample(range(number), min(number, 1)))


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
