"""What has a value reference in an FMU: each Real number by itself or, from FMI 3.0 on, all of a quantity together."""

from dataclasses import dataclass
from itertools import groupby

from rbfmu_fmu.description import Description, Variable
from rbfmu_kernels.quantities import BY_NAME


@dataclass(frozen=True)
class Referenced:
    """A variable of the model description; its value reference is its place among all of them.

    elements: numbers of `Description.variables`, row by row; dimensions: none of a scalar.
    """

    name: str
    elements: tuple[int, ...]
    dimensions: tuple[int, ...]


def scalars(d: Description) -> list[Referenced]:
    """Return a variable for each number."""
    return [Referenced(v.name, (k,), ()) for k, v in enumerate(d.variables)]


def arrays(d: Description) -> list[Referenced]:
    """Return a variable for each quantity; a symmetric matrix has its lower triangle as well."""
    numbered = enumerate(d.variables)
    return [_array(block, list(members)) for block, members in groupby(numbered, lambda one: one[1].block)]


def _array(name: str, members: list[tuple[int, Variable]]) -> Referenced:
    first, elements = members[0][0], BY_NAME[name].elements
    if len(members) == 1:
        return Referenced(name, (first,), ())
    if not elements:
        return Referenced(name, tuple(k for k, _ in members), (len(members),))
    place = {frozenset(element.split(",")): first + k for k, element in enumerate(elements)}
    rows = sorted({row for pair in place for row in pair})
    return Referenced(name, tuple(place[frozenset((i, j))] for i in rows for j in rows), (len(rows), len(rows)))
