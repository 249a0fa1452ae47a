"""The table of quantities: what is made from it has its names, sizes and order; nothing says them a second time."""

from pathlib import Path

import numpy as np
import pytest

from rbfmu.scene.scene import PARAMETERS, Initial, Loads
from rbfmu_kernels import quantities
from rbfmu_kernels.body import memory
from rbfmu_kernels.buffer import FAULTS, NEGATIVE
from rbfmu_kernels.quantities import BY_NAME, NEEDS, OUTPUTS, UNITS, active_flags, indices, needing


def test_every_load_and_initial_value_of_a_scene_has_a_row_and_every_row_its_key() -> None:
    assert tuple(Loads._keys) == tuple(load.name for load in quantities.LOADS)
    assert tuple(f"{name}_0" for name in Initial._rules) == tuple(r.name for r in quantities.INITIAL_VALUES)


def test_names_are_distinct_and_units_are_known() -> None:
    rows = (*quantities.PARAMETERS, *quantities.LOADS, *quantities.INITIAL_VALUES, *OUTPUTS)
    assert len(BY_NAME) == len(rows)
    assert {row.unit for row in rows} <= set(UNITS)
    assert all(len(row.bounds) in (1, row.size) and len(indices(row)) == row.size for row in rows)
    assert all(len(row.components) == row.size or row.name == "quaternion" for row in OUTPUTS)
    assert {row.name for row in OUTPUTS if row.judged_by} == {"rpy"}
    assert all(set(row.needs) <= set(NEEDS) and set(row.initially) <= set(BY_NAME) for row in OUTPUTS)


def test_a_buffer_has_the_blocks_of_the_table() -> None:
    assert tuple(memory.PARAMETERS) == tuple(getattr(BY_NAME[name], "block", name) for name in PARAMETERS)
    sizes = memory.INPUTS | memory.PARAMETERS | memory.OUTPUTS
    assert all(memory.BLOCKS[name].stop - memory.BLOCKS[name].start == size for name, size in sizes.items())


def test_only_the_needs_of_active_outputs_are_flagged() -> None:
    assert active_flags(()) == [0.0] * (len(OUTPUTS) + len(NEEDS))
    for row in OUTPUTS:
        flags = active_flags([row.name])
        assert flags[: len(OUTPUTS)] == [float(other is row) for other in OUTPUTS]
        assert flags[len(OUTPUTS) :] == [float(need in row.needs) for need in NEEDS]
    assert needing(*NEEDS) == {row.name for row in OUTPUTS}


def test_the_table_needs_neither_numba_nor_numpy() -> None:
    source = Path(quantities.__file__).read_text(encoding="utf-8")
    found = {line for line in source.splitlines() if line.startswith(("import ", "from "))}
    assert found == {"import math", "from collections.abc import Collection", "from typing import NamedTuple"}


def test_a_load_that_closed_forms_do_not_know_is_noticed_where_it_acts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such a load is a row without `in_closed_forms`; there is none yet, so that another load stands for it."""
    place, z = memory.BLOCKS["damping_b"], np.zeros(memory.BLOCKS["M"].stop)
    has_unknown_load = getattr(memory.has_unknown_load, "py_func", memory.has_unknown_load)
    z[place] = 1.0
    assert not has_unknown_load(z)
    monkeypatch.setattr(memory, "_UNKNOWN", ((0, 0), (place.start, place.stop)))
    assert has_unknown_load(z)
    z[place] = 0.0
    assert not has_unknown_load(z)


def test_every_load_that_must_not_be_negative_has_a_fault_that_names_it() -> None:
    for i, load in enumerate(quantities.BOUNDED):
        assert FAULTS[NEGATIVE + i] == (load.name, f"expected no negative number ({load.unit})")
    assert [load.name for load in quantities.BOUNDED] == ["damping_b"]
