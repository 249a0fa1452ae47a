"""How what a motion begins with, and hangs on, changes with the parameters that it is made of.

`body/memory.initialize_body` makes a body's state, and what stands in its equations of motion, of its parameters. Here
are the derivatives of that, as numbers of the motion's graph, whose leaves they are of: linear in the changes of the
parameters, which are leaves as well.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from rbfmu.formulas.graph import Graph, Number, Symbol, changes_of, square_root
from rbfmu.formulas.motion import STATE, Motion
from rbfmu.formulas.text import Array
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.mechanics.inertia import parallel_axis
from rbfmu_kernels.quantities import elements
from rbfmu_kernels.rotations.vec3 import cross

MADE = ("M", "M_inverse", "arm", "inverse_mass")
"""The blocks that `initialize_body` makes of parameters, beside the state."""
CHANGE = "change of "
"""Before the name of a parameter's number, that of its change."""


class Start:
    """The leaves of a graph at the start, and how they change with the numbers of parameters."""

    def __init__(self, graph: Graph, parameters: Iterable[str]) -> None:
        """parameters: the names of their numbers."""
        self.graph = graph
        self.changes: dict[Symbol, Number] = {
            graph.leaf("place", name): graph.leaf("place", f"{CHANGE}{name}") for name in parameters
        }

    def leaves(self, name: str, size: int, kind: str = "place") -> list[Symbol]:
        """Return the numbers of a block."""
        return [self.graph.leaf(kind, element) for element in elements(name, size)]

    def set(self, leaves: Iterable[Number], changes: Iterable[Number]) -> None:
        """Let leaves change; those that are 0 in the graph stay so."""
        self.changes |= {x: dx for x, dx in zip(leaves, changes, strict=True) if isinstance(x, Symbol)}

    def of(self, values: Iterable[Number]) -> list[Number]:
        """Return how numbers change."""
        return changes_of([*values], self.changes)

    def normalize(self, q: Sequence[Symbol]) -> None:
        """Let an attitude change with the quaternion that it is made of, of any length."""
        first = self.leaves("quaternion_0", 4)
        changes, size = self.of(first), square_root(sum((x * x for x in first), 0.0))
        along = sum((x * dx for x, dx in zip(q, changes, strict=True)), 0.0)
        self.set(q, [(dx - x * along) / size for x, dx in zip(q, changes, strict=True)])

    def begin(self, motion: Motion) -> None:
        """Let all else change, once the attitude does, which turns what lies between o and the centre of mass."""
        known, omega, pivot = motion.names, motion.omega, motion.given.pivot
        self.set(omega, self.of(self.leaves("omega_b_0", 3)))
        mass, arm, M = known["mass"], known["r_oc_b"], inertia_of(motion)
        inverse = np.array(self.leaves("M_inverse", 9), object).reshape(3, 3)
        by_M = np.array(self.of(np.ravel(M)), object)
        self.set(self.leaves("M", 9), by_M)
        self.set(np.ravel(inverse), np.ravel(-1.0 * (inverse @ by_M.reshape(3, 3) @ inverse)))
        self.set(self.leaves("arm", 3), self.of(arm if pivot else [-1.0 * x for x in arm]))
        if not pivot:
            inverse_mass = self.leaves("inverse_mass", 1)
            self.set(inverse_mass, [-1.0 * inverse_mass[0] * inverse_mass[0] * self.of([mass])[0]])
            lever = interpreted(cross)(tuple(omega), tuple(arm))
            for state, first, beside in (("r_c", "position_0", arm), ("v_c", "velocity_0", lever)):
                values = np.array(self.leaves(first, 3), object) + motion.to_a(np.array(beside, object))
                self.set(self.leaves(state, 3, "state"), self.of(values))
        for name, size in motion.given.states.items():
            self.set(self.leaves(f"{STATE}{name}", size, "state"), self.of(self.leaves(f"{STATE}{name}_0", size)))


def inertia_of(motion: Motion) -> Array:
    """Return the inertia that turns a body, by its parameters: about the centre of mass, or about a pivot."""
    M, mass, arm = (motion.names[name] for name in ("M_c", "mass", "r_oc_b"))
    return np.array(interpreted(parallel_axis)(M, mass, tuple(arm)), object) if motion.given.pivot else M
