"""Layout of a co-simulation unit's flat buffer: names of its variables, their places, where outputs begin.

A unit's whole memory is one float64 buffer, so a copy of its bytes is a snapshot and the same entry functions
serve Python, pythonfmu and native code. This module needs neither numba nor numpy.
"""


def places(sizes: dict[str, int]) -> tuple[dict[str, slice], int]:
    """Consecutive places in a buffer for named blocks, and the total size."""
    blocks: dict[str, slice] = {}
    total = 0
    for name, size in sizes.items():
        blocks[name] = slice(total, total + size)
        total += size
    return blocks, total


FINE, NOT_REACHED, PAST_STOP = 0, 1, 2
"""Values of the variable `status`; `step` returns FINE or NOT_REACHED."""

MOST_SUBSTEPS = 1e9
"""Substeps in one communication step above which a step is refused rather than hang the host."""

FAULTS = {
    1: "mass must be positive and finite",
    2: "inertia must be finite",
    3: "inertia must be symmetric",
    4: "inertia has a negative principal moment",
    5: "inertia breaks the triangle inequality (a moment above the sum of the other two)",
    6: "inertia has two zero principal moments: a slender beam has one, no body has two",
    7: "quaternion_0 must be finite and not zero",
    8: "a parameter or initial value is not finite",
    9: "omega_b_0 turns a slender beam about its own axis, where it has no inertia",
    10: "damping_b must not be negative",
}
"""What a unit's `initialize` refuses, by its return value."""
