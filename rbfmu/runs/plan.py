"""The plan of a run: the name of the model, the settings of its method, and the buffer from which a run starts."""

import math
from collections.abc import Collection
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from rbfmu.models.model_buffer import aligned_zeros, put_scene, refusal
from rbfmu.models.registry import FORMULAS, MODELS, PRESCRIBED_RATES, ModelSpec
from rbfmu.notebook import table
from rbfmu.scene.own import OF_NUMBERS
from rbfmu.scene.scene import PARAMETERS, Scene, SceneError
from rbfmu.scene.section import as_toml, fault, plain
from rbfmu.types import Buffer
from rbfmu_kernels.body.shell import Model
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import IN_BUFFER_ORDER, INITIAL_VALUES, LOADS, active_flags

if TYPE_CHECKING:
    from rbfmu.models.formulas import FormulaModel


KEYS = (
    {name: f"body.{name}" for name in PARAMETERS}
    | {load.name: f"loads.{load.name}" for load in LOADS}
    | {row.name: f"initial.{row.name.removesuffix('_0')}" for row in INITIAL_VALUES}
    | {"quaternion_0": "initial.attitude.quaternion"}
)
"""The scene's keys by the names of parameters."""
BLOCK_OF = {row.name: row.block for row in IN_BUFFER_ORDER}
"""The blocks of a buffer by the names of parameters."""


@dataclass(frozen=True, repr=False)
class Plan:
    """What simulates a scene, and why.

    substep: s, for series the one tried first; infinite if the method chooses or needs none; tolerance: the largest
    estimated error of a substep, or, if `span` is not 0, of all substeps of a run of `span` s together; 0 if no error
    is estimated; order: of the splitting or of the series, 0 if there is none; formulas: the model of the scene's
    formulas, if any; pinned: parameters for whose values the model was judged, so that an importer must not change
    them; error: the largest expected, as the scene's `accuracy` measures it; cost: ns a communication step, with the
    outputs asked for, on `methods.MACHINE`; interpolated: whether runs are taken whole, with substeps of their own,
    inside which outputs are interpolated; its tolerance is for these, and not for an FMU or a scene with ports.
    """

    model: str
    method: str
    states: int
    substep: float = math.inf
    tolerance: float = 0.0
    order: int = 0
    pinned: tuple[str, ...] = ()
    error: float = 0.0
    cost: float = 0.0
    span: float = 0.0
    reasons: tuple[str, ...] = ()
    interpolated: bool = False
    formulas: "FormulaModel | None" = field(default=None, compare=False)

    def __repr__(self) -> str:
        return f"Plan({self.model}: {self.method}; {self.states} states, error {self.error:.1e})"

    def _repr_html_(self) -> str:
        values = {"method": self.method, "states": self.states, "error expected": f"{self.error:.1e}"}
        return table(self.model, ("", ""), [*values.items(), *(("because", reason) for reason in self.reasons)])

    def to_dict(self) -> dict[str, Any]:
        """Return the plan for JSON, where an infinite substep is None."""
        known = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "formulas"}
        return known | {"substep": self.substep if math.isfinite(self.substep) else None}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Plan":
        """Return the plan from what `to_dict` returned, also after JSON. Raises ValueError for anything else."""
        try:
            substep = math.inf if data["substep"] is None else data["substep"]
            lists = {"pinned": tuple(data["pinned"]), "reasons": tuple(data["reasons"])}
            return cls(**data | {"substep": substep} | lists)
        except (KeyError, TypeError) as error:
            raise ValueError(fault("data", data, f"what Plan.to_dict returned ({error})")) from None

    @property
    def spec(self) -> ModelSpec:
        """Return the specification of the model. Raises ValueError for an unknown name."""
        if (found := FORMULAS if self.model == FORMULAS.key else MODELS.get(self.model)) is None:
            raise _bad_setting("model", self.model, f"one of {', '.join(MODELS)}")
        return found

    @property
    def kernels(self) -> Model:
        """Return the model of `rbfmu_kernels.models` that runs it, or that of the scene's formulas."""
        return self.formulas.model if self.formulas else self.spec.kernels

    @property
    def runs_through(self) -> bool:
        """Return whether whole runs have substeps of their own."""
        return self.interpolated and self.kernels.run_through is not None

    def of_scene(self, scene: Scene) -> "Plan":
        """Return the plan with the kernels of the scene's formulas, if it has any.

        A plan read from a file has none. Those of another scene's plan may be for other texts, or may leave out loads
        that are zero there. Raises ValueError if the model cannot represent what moves the body, or for a plan of whole
        runs if the scene has ports, whose inputs change between communication points.
        """
        if self.interpolated and scene.inputs.ports:
            raise _bad_setting("interpolated", True, "a plan by rbfmu.plan, as the scene has ports")
        if (scene.body is None) != (self.model == PRESCRIBED_RATES.key):
            raise _bad_setting("model", self.model, "a model of a body" if scene.body else f"{PRESCRIBED_RATES.key!r}")
        by_formulas = scene.has_formulas or self.model == FORMULAS.key
        if self.formulas.serves(scene) if self.formulas else not by_formulas:
            return self
        from rbfmu.models.formulas import OverClosedForm, equations_of  # only if needed, as it loads slowly

        formulas = equations_of(scene)
        own_outputs_alone = self.model != FORMULAS.key
        if own_outputs_alone and (formulas.plain_loads is None or scene.states or scene.events):
            raise _bad_setting("model", self.model, f"{FORMULAS.key!r}, as formulas take part in the motion")
        return replace(self, formulas=OverClosedForm(formulas, self.spec.module) if own_outputs_alone else formulas)

    @property
    def settings(self) -> dict[str, float]:
        """Return the plan's numbers for the model's buffer, by block."""
        return {
            "substep": self.substep if math.isfinite(self.substep) else 0.0, "tolerance": self.tolerance,
            "span": self.span, "order": self.order, "skip_model_checks": float(bool(self.pinned)),
        }  # fmt: skip

    def check(self) -> None:
        """Raise ValueError for a setting with which the model cannot run."""
        orders = self.kernels.ORDERS or (self.order,)
        if self.order not in orders:
            raise _bad_setting("order", self.order, f"one of {', '.join(map(str, orders))} for {self.model!r}")
        for name in ("substep", "tolerance", "span"):
            if not (value := getattr(self, name)) >= 0.0:
                raise _bad_setting(name, value, "a number that is not negative")


def checked_plan(planned: object, stepped: bool = False) -> Plan | None:
    """Return a given plan, or None. Raises TypeError for anything else, ValueError for one of whole runs if `stepped`.

    stepped: whether a run goes from one communication point to the next; a tolerance for longer substeps fits none.
    """
    if stepped and isinstance(planned, Plan) and planned.interpolated:
        raise _bad_setting("interpolated", True, "a plan by rbfmu.plan, whose tolerance is for steps between points")
    if planned is None or isinstance(planned, Plan):
        return planned
    raise TypeError(fault("planned", planned, "a rbfmu.Plan, as rbfmu.plan returns it"))


def _bad_setting(name: str, value: object, expected: str) -> ValueError:
    return ValueError(f"Plan.{name} = {value!r}: expected {expected}")


# The buffer of a run


def filled_buffer(scene: Scene, plan: Plan, names: Collection[str] | None = None) -> Buffer:
    """Return the buffer of the plan's model before `initialize`: the scene's numbers, the plan's settings, no inputs.

    names: the outputs that are computed, in place of the scene's. Raises ValueError if the plan cannot be run.
    """
    plan.check()
    kernels = plan.kernels
    z = aligned_zeros(kernels.SIZE)
    put_scene(scene, kernels.BLOCKS, z, plan.settings)
    if names is not None and "active" in kernels.BLOCKS:
        z[kernels.BLOCKS["active"]] = active_flags(names)
    return z


def initialize(scene: Scene, kernels: Model, z: Buffer) -> None:
    """Set state and outputs from the parameters. Raises SceneError if the model refuses them."""
    if code := tiered(kernels.initialize)(z):
        raise refusal(scene, code, kernels.BLOCKS, z)


def start_run(scene: Scene, plan: Plan, names: Collection[str] | None = None) -> Buffer:
    """Return the buffer of the plan's model at the start; names: as in `filled_buffer`.

    Raises as `filled_buffer` and `initialize`.
    """
    z = filled_buffer(scene, plan, names)
    initialize(scene, plan.kernels, z)
    return z


# Other values of parameters


def with_parameters(scene: Scene, planned: Plan, parameters: dict[str, Any]) -> Scene:
    """Return the scene with other values of parameters, by name.

    Raises SceneError for an unknown name, a wrong value, or a parameter that is pinned by the plan.
    """
    if not parameters:
        return scene
    own = scene.own_parameters
    keys = KEYS | {row.name: key for key, row in own.items()}
    block_of = BLOCK_OF | {row.name: row.block for row in own.values()}
    for name in parameters:
        if name not in keys or (scene.body is None and name != "quaternion_0"):
            whole = name.partition("[")[0]
            meant = next((key for key in (whole, f"{whole}_0") if key in keys and key != name), "")
            expected = f"{meant}, with all of its numbers" if meant else f"one of {', '.join(keys)}"
            raise SceneError(f"parameter {name!r}: expected {expected}", scene.name)
        if name in scene.loads.made:
            raise SceneError(fault(name, parameters[name], OF_NUMBERS), scene.name)
    numbers = {name: plain(value) for name, value in parameters.items()}
    for row in own.values():
        if row.name in numbers and isinstance(numbers[row.name], list | tuple) != (row.size > 1):
            expected = "3 numbers" if row.size > 1 else "a number"  # as in the buffer and in formulas
            raise SceneError(fault(row.name, numbers[row.name], expected), scene.name)
    changed = scene.replace({keys[name]: value for name, value in numbers.items()})
    blocks, old, new = planned.kernels.BLOCKS, filled_buffer(scene, planned), filled_buffer(changed, planned)
    for name in parameters:
        place = blocks.get(block_of[name], slice(0))  # a constant that no formula reads has no block
        values = old[place].tolist()
        if name in planned.pinned and values != new[place].tolist():
            made_for = f"{as_toml(values if len(values) > 1 else values[0])}, for which the model was planned"
            expected = f"{made_for}; list {name!r} in inputs.parameters to vary it"
            raise SceneError(fault(name, parameters[name], expected), scene.name)
    return changed
