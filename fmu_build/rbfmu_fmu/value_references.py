"""What has a value reference in an FMU: each Real number by itself or, from FMI 3.0 on, all of a quantity together."""

from dataclasses import dataclass

from rbfmu_fmu.description import Description, blocks
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
    found = blocks(d, "input", "parameter", "output")
    return [_array(name, d.variables.index(members[0]), len(members)) for name, members in found.items()]


def _array(name: str, first: int, size: int) -> Referenced:
    elements = BY_NAME[name].elements
    if size == 1:
        return Referenced(name, (first,), ())
    if not elements:
        return Referenced(name, tuple(range(first, first + size)), (size,))
    place = {frozenset(element.split(",")): first + k for k, element in enumerate(elements)}
    rows = sorted({row for pair in place for row in pair})
    return Referenced(name, tuple(place[frozenset((i, j))] for i in rows for j in rows), (len(rows), len(rows)))
