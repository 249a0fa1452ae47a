"""Layout of a model's flat buffer: names of its variables, their places, where outputs begin.

A model's whole memory is one float64 buffer, so a copy of its bytes is a snapshot and the same entry functions
serve Python, pythonfmu and native code. This module needs neither numba nor numpy.
"""

from collections import namedtuple
from typing import Any, NamedTuple

from .quantities import BOUNDED


class Layout(NamedTuple):
    """The blocks of a buffer: the place of each by its name, and the size of all together."""

    blocks: dict[str, slice]
    size: int

    @property
    def at(self) -> Any:
        """Where each block begins: a named tuple with the blocks' names, in their order; constants in compiled code."""
        return namedtuple("At", self.blocks)(*(block.start for block in self.blocks.values()))


def places(sizes: dict[str, int], first: int = 0) -> Layout:
    """Return consecutive places in a buffer, from the first on, for named blocks."""
    blocks: dict[str, slice] = {}
    end = first
    for name, size in sizes.items():
        blocks[name] = slice(end, end + size)
        end += size
    return Layout(blocks, end - first)


def with_work_space(sizes: dict[str, int], size: int) -> Layout:
    """Return the places of blocks and of a work space after them, which begins at a cache line if the buffer does."""
    return places(sizes | {"pad_3": -places(sizes).size % 8, "work": size})


OK, STEP_REJECTED, PAST_STOP = 0, 1, 2
"""Values of the variable `status`; `step` returns OK or STEP_REJECTED."""

MAX_SUBSTEPS = 1e7
"""The largest number of substeps in one communication step (seconds of work): with more, a step is refused rather than
hang the host."""
MOST_LISTED = 4096
"""The largest number of events in one communication step: with more, a step is refused, as chatter would never end."""


NO_MASS, TWO_ZERO_MOMENTS, NO_ATTITUDE, NOT_FINITE, BEAM_TURNS, NO_OUTPUTS = 1, 6, 7, 8, 9, 10
"""Faults at the start; those from 2 to 5 are one more than what `mechanics.inertia.check_inertia` returns."""
CHANGED = "*"
"""The block of a fault that is in no single block: some number is no longer what the model was planned for."""

(
    TORQUE_ACTS, NO_TOP, RESONANT, TURNS, UNSTEADY, UNSYMMETRIC, MORE_AXES, NO_PENDULUM, NO_SPIN_UP, MORE_THAN_MOMENTUM,
) = range(11, 21)  # fmt: skip
"""Faults of bodies for which a model is not valid."""
FAULTS: dict[int, tuple[str, str]] = {
    NO_MASS: ("mass", "expected a positive number (kg)"),
    2: ("inertia", "expected finite numbers (kg m2)"),
    3: ("inertia", "expected a symmetric matrix"),
    4: ("inertia", "expected no negative principal moment"),
    5: ("inertia", "expected no principal moment above the sum of the other two"),
    TWO_ZERO_MOMENTS: ("inertia", "expected at most one zero principal moment (a slender beam)"),
    NO_ATTITUDE: ("quaternion_0", "expected finite numbers, not all zero"),
    NOT_FINITE: ("", "expected finite numbers in all parameters and initial values"),
    BEAM_TURNS: ("omega_b_0", "expected no rate about a slender beam's own axis, where it has no inertia"),
    NO_OUTPUTS: ("outputs", "expected finite numbers with these parameters, initial values and inputs"),
    TORQUE_ACTS: (CHANGED, "expected loads without torque: this model is torque-free"),
    NO_TOP: (CHANGED, "expected two equal moments, no damping: this model is a symmetric top"),
    RESONANT: (CHANGED, "expected a rate at which the planned substep is below half the resonance of a top's "
               "splitting"),
    TURNS: (CHANGED, "expected no rate and no torque: this model does not turn"),
    UNSTEADY: (CHANGED, "expected a rate about a principal axis: this model's rate is constant"),
    UNSYMMETRIC: (CHANGED, "expected two equal moments: this model is a symmetric body's"),
    MORE_AXES: (CHANGED, "expected rate and torque about one principal axis: this model turns about a single one"),
    NO_PENDULUM: (CHANGED, "expected no damping or torque but that of weight: this model is an undamped pendulum"),
    NO_SPIN_UP: (CHANGED, "expected two equal moments, torque and damping about the third axis alone, no attitude to "
                 "show: this model is a symmetric body spun up"),
    MORE_THAN_MOMENTUM: (CHANGED, "expected no torque but torque_a, and three equal moments where rates are shown: "
                         "this model has the angular momentum alone"),
}  # fmt: skip
NEGATIVE = max(FAULTS) + 1
"""The fault of the first load that must not be negative; the faults of the others follow."""
FAULTS |= {NEGATIVE + i: (load.name, f"expected no negative number ({load.unit})") for i, load in enumerate(BOUNDED)}
"""What a model's `initialize` refuses, by its return value: the block (empty for any, or CHANGED), and what was
expected."""
