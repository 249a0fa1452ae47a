"""The motion of a scene as a graph: the rates of its states, and the quantities that it shows.

The equations of motion are the kernels' own, run in plain Python on numbers of the graph. Numbers of the scene that are
zero are zero in the graph as well, so that their products are left out; all others are places of the buffer.

`body/memory.initialize_body` computes a body's state, and the constants of its equations of motion, from its
parameters. `Start` has the derivatives of these as numbers of the graph, linear in changes of parameters, which are
leaves.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

import rbfmu_kernels as kernels
from rbfmu.formulas.functions import FUNCTIONS, Array, Function, as_vector, clipped, cross, inverse_cosines, legs
from rbfmu.formulas.graph import Graph, Number, Symbol, changes_of, gradient, square_root
from rbfmu.formulas.text import value_of
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, angular_acceleration, steady_acceleration
from rbfmu_kernels.quantities import elements

LOADS = ("force_a", "force_b", "torque_a", "torque_b")
CONSTANT, STATE = "constants.", "states."
"""Prefixes of the scene's own constants and states on the graph, which also has names of the body's numbers."""
_ZERO = (0.0, 0.0, 0.0)
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def by_element(values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the elements of scalars, vectors and matrices with their names."""
    for name, value in values.items():
        numbers = np.ravel(np.array(value, object))
        yield from zip(elements(name, len(numbers)), numbers, strict=True)


class Given(NamedTuple):
    """The numbers of a scene that its formulas can read.

    numbers: the values of the body's blocks in the buffer and of constants, by name; symbolic: the names of those whose
    zeros may become other numbers; ports, states, constants: sizes by name; pivot: whether o is fixed.
    """

    numbers: Mapping[str, Sequence[float]]
    symbolic: frozenset[str]
    ports: Mapping[str, int]
    states: Mapping[str, int]
    constants: Mapping[str, int]
    pivot: bool

    @property
    def sizes(self) -> tuple[object, ...]:
        """Return the names and sizes of all that can be read, without the values."""
        return self.ports, self.states, self.constants, self.pivot


class Group(NamedTuple):
    """States whose errors are measured together; least: the least size that errors are relative to.

    relative: whether errors are relative to the largest size in the run, if that is larger.
    """

    states: tuple[str, ...]
    least: float
    relative: bool


def groups_of(names: Sequence[str]) -> list[Group]:
    """Return states in groups, one for each vector or scalar, the time last."""
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(name.partition("[")[0], []).append(name)
    least = {"q": (1.0, False), "r_c": (1.0, True), "v_c": (1.0, True), "t": (np.inf, False)}
    order = sorted(found, key=lambda name: name == "t")
    return [Group(tuple(found[name]), *least.get(name, (0.0, True))) for name in order]


class Motion:
    """A body under formulas: `names` that formulas can read, and the rates of its states, given its loads."""

    def __init__(self, given: Given) -> None:
        self.graph, self.given = Graph(dict(by_element(given.numbers))), given
        self.zeros: set[str] = set()  # places of the buffer that are assumed to stay zero
        q = self.q = self._leaves("state", "q", 4)
        self.omega = self._leaves("state", "omega", 3)
        self.t = self.graph.leaf("state", "t")
        self.R = rotation_of(q)
        r_oc = self._places("r_oc_b")
        self.v_c = self._leaves("state", "v_c", 3)
        if given.pivot:
            self.position, self.velocity = self._places("position_0"), np.array(_ZERO, object)
        else:
            self._r_c, lever = self._leaves("state", "r_c", 3), cross(self.omega, r_oc)
            self.position = _minus(self._r_c, self.to_a(r_oc))
            self.velocity = _minus(self.v_c, self.to_a(lever))
        self._M, self._arm = self._places("M").reshape(3, 3), self._places("arm")
        self.names = self._names(r_oc)

    def _names(self, r_oc: Array) -> dict[str, Any]:
        given = self.given
        inertia = self._places("inertia")
        M_c = np.array([[inertia[i] for i in row] for row in ((0, 3, 4), (3, 1, 5), (4, 5, 2))], object)
        known = {
            "t": self.t, "q_ab": self.q, "R_ab": self.R, "position": self.position, "velocity": self.velocity,
            "omega_b": self.omega, "omega_a": self.to_a(self.omega), "mass": self._places("mass")[0], "M_c": M_c,
            "M_o": None, "r_oc_b": r_oc, "gravity_a": self._places("gravity_a"),
        }  # fmt: skip
        self.given_names = frozenset(known)
        own = {name: self._places(f"{CONSTANT}{name}") for name in given.constants}
        own |= {name: self._leaves("state", f"{STATE}{name}", size) for name, size in given.states.items()}
        own |= {name: self._leaves("input", name, size) for name, size in given.ports.items()}
        return known | {name: x[0] if len(x) == 1 else x for name, x in own.items()}

    @property
    def functions(self) -> Mapping[str, Function]:
        """Return the functions that formulas of this scene can call, by name."""
        turning = {
            "to_a": Function("v", "a vector of b in a: R_ab @ v", lambda v: self.to_a(as_vector(v))),
            "to_b": Function("v", "a vector of a in b: R_ab transposed @ v", lambda v: self.to_b(as_vector(v))),
            **inverse_cosines(self._legs),
        }
        return {**FUNCTIONS, **turning}

    def _legs(self, x: Number) -> tuple[Number, Number]:
        """Return a cosine x and its sine; if x is an element of R_ab, the sine is the norm of the others in its row.

        This is accurate near 1. Such a cosine also needs no clip, which has a corner at 1 that a body at rest would
        never leave.
        """
        for row in self.R:
            for j, cosine in enumerate(row):
                if x in (cosine, clipped(cosine, -1.0, 1.0)):
                    return cosine, square_root(sum(y * y for y in np.delete(row, j)))
        return legs(x)

    def value(self, text: str) -> Array:
        """Return the value of a formula. Raises FormulaError."""
        if "M_o" in text:  # added only if a formula reads it: else operations keep their order
            self.names["M_o"] = inertia_of(self, about_o=True)
        return value_of(text, self.names, self.functions)

    def to_a(self, v: Array) -> Array:
        """Return a vector of b in a."""
        return self.R @ v

    def to_b(self, v: Array) -> Array:
        """Return a vector of a in b."""
        return self.R.T @ v

    def turns(self) -> Iterator[Array]:
        """Yield the rate of q for a rate of 1 rad/s about each axis of b."""
        return (np.array(interpreted(kernels.quaternion_rate_b)(tuple(self.q), axis), object) for axis in AXES)

    def forces_of(self, potential: Number) -> dict[str, Array]:
        """Return the force at o, in a, and the torque, in b, of a potential V, as loads of the scene by name.

        The work in a small displacement is -dV: the force is minus the derivative by the path. The torque about c
        (about o with a pivot) is minus the derivative by a small rotation about each axis of b.
        """
        slopes = np.array(gradient(potential, [*self.q, *([] if self.given.pivot else self._r_c)]), object)
        torque = np.array([-1.0 * (slopes[:4] @ turn) for turn in self.turns()], object)
        if self.given.pivot:
            return {"torque_b": torque}
        force = -1.0 * slopes[4:]
        return {"force_a": force, "torque_b": _minus(torque, cross(self._arm, self.to_b(force)))}

    def potential_energy(self, potential: Number, force_a: Array | None) -> Number:
        """Return the sum of a potential and those of gravity and of a constant force_a; None: the buffer's force_a."""
        is_free, mass = not self.given.pivot, self._places("mass")[0]
        centre = self._r_c if is_free else self.position + self.to_a(self._places("r_oc_b"))
        total: Number = potential - mass * (self._places("gravity_a") @ centre)
        force = self._places("constant_force_a") if force_a is None else force_a
        return total - force @ self.position if is_free else total

    def rates(self, loads: Mapping[str, Array]) -> Mapping[str, Number]:
        """Return the rates of the body's states by their elements' names; loads: given by formulas, by name."""
        given = self.given
        known = {name: loads[name] if name in loads else self._places(f"constant_{name}") for name in LOADS}
        for name in LOADS:
            if name in given.ports:
                known[name] = known[name] + self._leaves("input", name, 3)
        gravity = self._places("gravity_a")
        weight = self._places("mass") * gravity if given.pivot else np.array(_ZERO, object)
        force_a = weight if given.pivot else known["force_a"] + self.to_a(known["force_b"])
        force_b = self.to_b(weight) if given.pivot else known["force_b"] + self.to_b(known["force_a"])
        torque_b = known["torque_b"] + self.to_b(known["torque_a"])
        body = Body(
            inverse_mass=0.0 if given.pivot else self._places("inverse_mass")[0],
            inertia=_tuples(self._M), inertia_inverse=_tuples(self._places("M_inverse").reshape(3, 3)),
            arm_b=tuple(self._arm), damping_b=tuple(self._places("damping_b")), is_free=float(not given.pivot),
        )  # fmt: skip
        turning = Loads(_ZERO, _ZERO, tuple(force_b), _ZERO, tuple(torque_b))
        q, omega = tuple(self.q), tuple(self.omega)
        found = {
            "q": interpreted(kernels.quaternion_rate_b)(q, omega),
            "omega": interpreted(angular_acceleration)(q, omega, body, turning),
        }
        if not given.pivot:
            moving = Loads(tuple(gravity), tuple(force_a), _ZERO, _ZERO, _ZERO)
            found |= {"r_c": tuple(self.v_c), "v_c": interpreted(steady_acceleration)(body, moving)}
        return {"t": 1.0} | dict(by_element(found))

    def outputs(self, rates: Mapping[str, Number]) -> dict[str, Array]:
        """Return the quantities of a body by name; rates: as returned by `rates`."""
        omega, R, mass = self.omega, self.R, self._places("mass")[0]
        alpha = np.array([rates[name] for name in elements("omega", 3)], object)
        momentum = self._M @ omega
        energy = omega @ momentum
        acceleration = np.array(_ZERO, object)
        if not self.given.pivot:
            relative = interpreted(kernels.relative_acceleration)(*map(tuple, (omega, alpha, self._places("r_oc_b"))))
            acceleration = np.array([rates[name] for name in elements("v_c", 3)], object)
            acceleration = _minus(acceleration, R @ np.array(relative, object))
            energy += mass * (self.v_c @ self.v_c)
        return {
            "position": self.position, "velocity": self.velocity, "acceleration": acceleration, "quaternion": self.q,
            "omega_b": omega, "omega_a": self.to_a(omega), "alpha_b": alpha,
            "angular_momentum_a": R @ momentum, "kinetic_energy": np.array([0.5 * energy], object),
        }  # fmt: skip

    def _leaves(self, kind: str, name: str, size: int) -> Array:
        return np.array([self.graph.leaf(kind, element) for element in elements(name, size)], object)

    def _places(self, name: str) -> Array:
        """Return the numbers of a block of the buffer; those that are zero and cannot change are 0."""
        values, stays = self.given.numbers[name], name not in self.given.symbolic
        names, leaves = elements(name, len(values)), self._leaves("place", name, len(values))
        self.zeros |= {element for element, x in zip(names, values, strict=True) if stays and x == 0.0}
        return np.array([0.0 if e in self.zeros else leaf for e, leaf in zip(names, leaves, strict=True)], object)


def closure(rates: Mapping[str, Number], wanted: Sequence[Number], graph: Graph) -> list[str]:
    """Return the names of the states on which wanted numbers depend, directly or through other states' rates."""
    found: set[str] = set()
    left = list(wanted)
    while left:
        new = {str(x.value) for x in graph.reached_of(["state"], left)}
        left = [rates[name] for name in new - found]
        found |= new
    return [name for name in rates if name in found]


def rotation_of(q: Array) -> Array:
    """Return R of a unit quaternion: I + 2 eta S + 2 S S (E&G 6.163)."""
    S = skew(q[1:])
    SS = S @ S
    rows = ([float(i == j) + 2.0 * (q[0] * S[i, j] + SS[i, j]) for j in range(3)] for i in range(3))
    return np.array([*rows], object)


def skew(v: Array) -> Array:
    """Return the matrix of the vector product with v."""
    return np.array(interpreted(kernels.skew)(tuple(v)), object)


def _minus(a: Array, b: Array) -> Array:
    return np.array([x + -1.0 * y for x, y in zip(a, b, strict=True)], object)


def _tuples(matrix: Array) -> Any:
    return tuple(map(tuple, matrix))


# Derivatives of the state at the start, and of constants of the motion, by parameters

MADE = ("M", "M_inverse", "arm", "inverse_mass")
"""The blocks that `initialize_body` computes from parameters, besides the state."""
CHANGE = "change of "
"""Prefix of a parameter's number: together they name the number's change."""


class Start:
    """The changes of a graph's leaves at the start by changes of parameters."""

    def __init__(self, graph: Graph, parameters: Iterable[str]) -> None:
        """parameters: the names of their elements."""
        self.graph = graph
        self.changes: dict[Symbol, Number] = {
            graph.leaf("place", name): graph.leaf("place", f"{CHANGE}{name}") for name in parameters
        }

    def leaves(self, name: str, size: int, kind: str = "place") -> list[Symbol]:
        """Return the leaves of a block's elements."""
        return [self.graph.leaf(kind, element) for element in elements(name, size)]

    def set(self, leaves: Iterable[Number], changes: Iterable[Number]) -> None:
        """Set the changes of leaves; numbers that are 0 in the graph do not change."""
        self.changes |= {x: dx for x, dx in zip(leaves, changes, strict=True) if isinstance(x, Symbol)}

    def change_of(self, values: Iterable[Number]) -> list[Number]:
        """Return the changes of numbers."""
        return changes_of([*values], self.changes)

    def normalize(self, q: Sequence[Symbol]) -> None:
        """Set the change of the attitude q by that of quaternion_0, which may have any norm and is normalized."""
        first = self.leaves("quaternion_0", 4)
        changes, size = self.change_of(first), square_root(sum((x * x for x in first), 0.0))
        along = sum((x * dx for x, dx in zip(q, changes, strict=True)), 0.0)
        self.set(q, [(dx - x * along) / size for x, dx in zip(q, changes, strict=True)])

    def begin(self, motion: Motion) -> None:
        """Set all other changes, after that of the attitude, on which the position of the centre of mass depends."""
        known, omega, pivot = motion.names, motion.omega, motion.given.pivot
        self.set(omega, self.change_of(self.leaves("omega_b_0", 3)))
        mass, arm, M = known["mass"], known["r_oc_b"], inertia_of(motion, about_o=pivot)
        inverse = np.array(self.leaves("M_inverse", 9), object).reshape(3, 3)
        by_M = np.array(self.change_of(np.ravel(M)), object)
        self.set(self.leaves("M", 9), by_M)
        self.set(np.ravel(inverse), np.ravel(-1.0 * (inverse @ by_M.reshape(3, 3) @ inverse)))
        self.set(self.leaves("arm", 3), self.change_of(arm if pivot else [-1.0 * x for x in arm]))
        if not pivot:
            inverse_mass = self.leaves("inverse_mass", 1)
            self.set(inverse_mass, [-1.0 * inverse_mass[0] * inverse_mass[0] * self.change_of([mass])[0]])
            lever = cross(omega, arm)
            for state, first, beside in (("r_c", "position_0", arm), ("v_c", "velocity_0", lever)):
                values = np.array(self.leaves(first, 3), object) + motion.to_a(np.array(beside, object))
                self.set(self.leaves(state, 3, "state"), self.change_of(values))
        for name, size in motion.given.states.items():
            starts = self.leaves(f"{STATE}{name}_0", size)
            self.set(self.leaves(f"{STATE}{name}", size, "state"), self.change_of(starts))


def inertia_of(motion: Motion, about_o: bool) -> Array:
    """Return a body's inertia by its parameters: about o, as needed with a pivot, or about the centre of mass."""
    M, mass, arm = (motion.names[name] for name in ("M_c", "mass", "r_oc_b"))
    return np.array(interpreted(kernels.parallel_axis)(M, mass, tuple(arm)), object) if about_o else M
