"""Derivatives of an FMU's outputs by its parameters in Initialization Mode, as C that is made for one scene.

What a parameter changes of the state at the start, and with it and by itself of the outputs, is the same for a closed
form as for a series: it comes of the graph of the motion, by forward accumulation, whatever model the plan chose.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rbfmu import Scene
from rbfmu.formulas.graph import LEAVES, Graph, Number, Symbol, arctangent, changes_of, square_root
from rbfmu.formulas.motion import STATE, Motion, by_element, rotation_of
from rbfmu.formulas.source import VALUES, lines_of
from rbfmu.models.formulas import texts_of
from rbfmu_fmu.description import Description
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.mechanics.inertia import parallel_axis
from rbfmu_kernels.quantities import elements
from rbfmu_kernels.rotations.vec3 import cross

Shown = Mapping[str, Sequence[Number]]
CHANGE = "change of "
"""Before the name of a place, that of its change."""
_IN_C = {kind: text.replace("math.", "") for kind, text in VALUES.items()} | {
    "sin": "sin({})", "cos": "cos({})", "exp": "exp({})", "log": "log({})", "power": "pow({}, {})",
    "select": "{0} > 0.0 ? {1} : {2}",
}  # fmt: skip


def slopes_header(d: Description) -> str:
    """Return C source of `add_changes`, which adds to the changes of outputs what those of parameters make of them."""
    blocks = d.plan.kernels.BLOCKS
    start = _Start(blocks, {v.offset for v in d.variables if v.causality == "parameter"})
    shown = _prescribed(start) if d.scene.body is None else _of_body(start, d.scene)
    outputs = [v for v in d.outputs if v.block in shown]  # the last time of an event is none of the motion's
    places = [v.offset - blocks[start.block_of(v.block)].start for v in outputs]
    changes = changes_of([shown[v.block][i] for v, i in zip(outputs, places, strict=True)], start.changes)
    lines, found = lines_of(start.graph, changes, start.texts, _IN_C)
    added = [f"change[{v.offset}] += {x};" for v, x in zip(outputs, found, strict=True) if x != 0.0]
    return "\n".join([
        "/* How outputs change at once with parameters at the start, made from the graph of the motion. */",
        "#include <math.h>",
        "static void add_changes(const double *z, double *change) {",
        *(f"    const double {line};" for line in lines), *(f"    {line}" for line in added),
        "    (void)z, (void)change;", "}", "",
    ])  # fmt: skip


class _Start:
    """The leaves of a graph at the start: where a buffer has them, and how they change with parameters."""

    def __init__(self, blocks: Mapping[str, slice], parameters: set[int]) -> None:
        """parameters: the places of those that an FMU has."""
        self._blocks, self.changes = blocks, dict[Symbol, Number]()
        self.set_by = {name: block for name, block in blocks.items() if block.start in parameters}
        self.graph = Graph()

    def read(self, graph: Graph) -> None:
        """Take a graph, whose places change as the parameters that they hold."""
        self.graph = graph
        for name, block in self.set_by.items():
            for element in elements(name, block.stop - block.start):
                self.changes[graph.leaf("place", element)] = graph.leaf("place", f"{CHANGE}{element}")

    def leaves(self, name: str, size: int, kind: str = "place") -> list[Symbol]:
        """Return the numbers of a block."""
        return [self.graph.leaf(kind, element) for element in elements(name, size)]

    def set(self, leaves: Iterable[Number], changes: Iterable[Number]) -> None:
        """Let leaves change; those that are 0 in the graph stay so."""
        self.changes |= {x: dx for x, dx in zip(leaves, changes, strict=True) if isinstance(x, Symbol)}

    def of(self, values: Iterable[Number]) -> list[Number]:
        """Return how numbers change."""
        return changes_of([*values], self.changes)

    def turn(self, q: Sequence[Symbol]) -> None:
        """Let an attitude change with what it is normalised of."""
        first = self.leaves("quaternion_0", 4)
        changes, size = self.of(first), square_root(sum((x * x for x in first), 0.0))
        along = sum((x * dx for x, dx in zip(q, changes, strict=True)), 0.0)
        self.set(q, [(dx - x * along) / size for x, dx in zip(q, changes, strict=True)])

    def block_of(self, name: str) -> str:
        """Return the block that has a variable or the numbers of leaves."""
        return next((one for one in (name, f"{STATE}{name}", f"series.{name}") if one in self._blocks), "")

    @property
    def texts(self) -> dict[str, str]:
        """Return the leaves as C; a model that reads no time has none."""
        found = {}
        for name in (str(one.value) for one in self.graph.operations if one.kind in LEAVES):
            block, _, index = name.removeprefix(CHANGE).partition("[")
            if not (known := self.block_of("time" if block == "t" else block)):
                continue
            place = self._blocks[known].start
            array = "change" if name.startswith(CHANGE) else "z"
            found[name] = f"{array}[{place + (int(index[:-1]) - 1 if index else 0)}]"
        return found


def _prescribed(start: _Start) -> Shown:
    start.read(start.graph)
    q, omega = (np.array(start.leaves(*of), object) for of in (("quaternion", 4, "state"), ("omega_b", 3, "input")))
    start.turn(q.tolist())
    R = rotation_of(q)
    return {"quaternion": q.tolist(), "rpy": _roll_pitch_yaw(R), "omega_a": (R @ omega).tolist()}


def _of_body(start: _Start, scene: Scene) -> Shown:
    _, given, texts = texts_of(scene, {"M", "M_inverse", "arm", "inverse_mass", *start.set_by})
    motion = texts.motion
    start.read(motion.graph)
    _begin(start, motion, given.pivot)
    for name, size in given.states.items():
        start.set(start.leaves(f"{STATE}{name}", size, "state"), start.of(start.leaves(f"{STATE}{name}_0", size)))
    rates = {**motion.rates(texts.loads), **dict(by_element({f"{STATE}{n}": x for n, x in texts.states.items()}))}
    shown = {**motion.outputs(rates), **texts.own, "rpy": _roll_pitch_yaw(motion.R)}
    shown |= {name: start.leaves(f"{STATE}{name}", size, "state") for name, size in given.states.items()}
    return {name: [*np.ravel(value)] for name, value in shown.items()}


def _begin(start: _Start, motion: Motion, pivot: bool) -> None:
    """Let the body's state and what `initialize_body` makes of its parameters change with these."""
    known, q, omega = motion.names, motion.q, motion.omega
    start.turn(q)
    start.set(omega, start.of(start.leaves("omega_b_0", 3)))
    mass, arm, M = known["mass"], known["r_oc_b"], known["M_c"]
    M = np.array(interpreted(parallel_axis)(M, mass, tuple(arm)), object) if pivot else M
    inverse = np.array(start.leaves("M_inverse", 9), object).reshape(3, 3)
    by_M = np.array(start.of(np.ravel(M)), object)
    start.set(start.leaves("M", 9), by_M)
    start.set(np.ravel(inverse), np.ravel(-1.0 * (inverse @ by_M.reshape(3, 3) @ inverse)))
    start.set(start.leaves("arm", 3), start.of(arm if pivot else [-1.0 * x for x in arm]))
    if not pivot:
        inverse_mass = start.leaves("inverse_mass", 1)
        start.set(inverse_mass, [-1.0 * inverse_mass[0] * inverse_mass[0] * start.of([mass])[0]])
        lever = interpreted(cross)(tuple(omega), tuple(arm))
        for state, first, beside in (("r_c", "position_0", arm), ("v_c", "velocity_0", lever)):
            values = np.array(start.leaves(first, 3), object) + motion.to_a(np.array(beside, object))
            start.set(start.leaves(state, 3, "state"), start.of(values))


def _roll_pitch_yaw(R: NDArray[np.object_]) -> list[Number]:
    """Return the angles of R = R_z(yaw) R_y(pitch) R_x(roll) by its elements; at the pole they have no derivative."""
    level = square_root(R[0][0] * R[0][0] + R[1][0] * R[1][0])
    return [arctangent(R[2][1], R[2][2]), arctangent(-1.0 * R[2][0], level), arctangent(R[1][0], R[0][0])]
