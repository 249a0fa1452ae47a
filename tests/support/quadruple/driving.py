"""A planned scene driven as its FMU drives it - parameters changed, other steps, ports held - and judged."""

from dataclasses import dataclass, field, replace

import numpy as np

from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_fmu.description import describe
from rbfmu_fmu.python.slave_access import HELD
from rbfmu_kernels.buffer import CHANGED, FAULTS, OK
from tests.support.quadruple import reference
from tests.support.quadruple.errors import errors

MAX_POINTS = 200
BEYOND = 3.0
"""Times the accuracy: what no promised answer may be off by."""


@dataclass(frozen=True)
class Setting:
    """What an importer does with a scene's FMU.

    changes: parameters by block name; step: the communication step, s, None: the scene's; inputs: by port, rows that
    are held over equal shares of the run.
    """

    changes: dict = field(default_factory=dict)
    step: float | None = None
    inputs: dict = field(default_factory=dict)


AS_PLANNED = Setting()


@dataclass(frozen=True)
class Outcome:
    """Either a refusal's message, or the errors by quantity."""

    refused: str = ""
    errors: dict = field(default_factory=dict)

    @property
    def error(self):
        return max(self.errors.values(), default=0.0)


def seen(scene: Scene, plan: Plan, setting: Setting):
    """Refusal and {}, or "" and the rows of all quantities asked for at the points of `grid`, driven as by an FMU."""
    description, unit = describe(scene, plan), plan.kernels
    z = np.array(description.start_buffer)
    for v in description.variables:
        if v.causality == "parameter" and v.block in setting.changes:
            z[v.offset] = setting.changes[v.block][int(v.offset) - first_of(description, v.block)]
    for v in description.variables:
        if v.pinned and z[v.offset] != v.start:
            return HELD % (v.name, z[v.offset], v.start, v.block), {}
    if fault := unit.initialize(z):
        block, expected = FAULTS[fault]
        changed = [v.block for v in description.variables if v.causality == "parameter" and z[v.offset] != v.start]
        return f"{sorted(set(changed)) if block == CHANGED else block}: {expected}", {}
    lengths, rows_of, stride = course(scene, setting)
    recorded = {name: [] for name in scene.outputs.quantities}
    for k in range(len(lengths) + 1):
        for port, rows in rows_of.items():
            z[unit.BLOCKS[port]] = rows[min(k, len(rows) - 1)] if k == 0 else rows[k - 1]
        if k == 0:
            unit.outputs(z)
        elif unit.step(z, lengths[k - 1]) != OK:
            return f"status 1 at step {k} of {len(lengths)}", {}
        if k % stride == 0 or k == len(lengths):
            for name, values in recorded.items():
                values.append(z[unit.BLOCKS[name]].copy())
    return "", {name: np.array(rows) for name, rows in recorded.items()}


def first_of(description, block):
    return min(v.offset for v in description.variables if v.block == block and v.causality == "parameter")


def course(scene: Scene, setting: Setting):
    """Lengths of the communication steps, inputs of each step by port, and of how many steps one is looked at."""
    run = scene.run
    lengths = np.diff(run._with(step=setting.step or run.step).grid())
    n = len(lengths)
    rows = {p: np.asarray(v, dtype=float)[np.arange(n) * len(v) // n] for p, v in setting.inputs.items()}
    return lengths, rows, max(1, -(-n // MAX_POINTS))


def true_motion(scene: Scene, setting: Setting, kind="quadruple", most=reference.MAX_SERIES):
    """The motion at the points that `seen` looks at."""
    lengths, rows, stride = course(scene, setting)
    n = len(lengths)
    parameters = reference.parameters_of(scene) | {k: list(v) for k, v in setting.changes.items()}
    looked = [*range(stride, n, stride), n]
    at = [0, *looked]
    if rows:
        driven = (parameters, lengths, rows)
        if scene.body is None:
            truth = reference.prescribed_motion(parameters["quaternion_0"], lengths, rows["omega_b"], kind)
        else:
            truth = reference.motion(*driven, kind=kind, most=most)
        return truth._replace(
            high={name: v[at] for name, v in truth.high.items()}, low={name: v[at] for name, v in truth.low.items()}
        )
    if scene.body is None:
        return reference.prescribed_motion(parameters["quaternion_0"], lengths[:1], np.zeros((1, 3)), kind)
    grid = scene.run._with(step=setting.step or scene.run.step).grid()
    return reference.motion(parameters, np.diff(grid[at]), kind=kind, most=most)


def outcome(scene: Scene, plan: Plan, setting: Setting = AS_PLANNED, most=reference.MAX_SERIES) -> Outcome:
    """Raises reference.TooDearError where the truth is out of reach."""
    truth = true_motion(scene, setting, most=most)  # first: what is too dear for it may take a plan minutes
    refused, rows = seen(scene, plan, setting)
    return Outcome(refused) if refused else Outcome("", errors(rows, truth))


def plainly_met(scene: Scene, setting: Setting = AS_PLANNED, most=reference.MAX_SERIES) -> float:
    """The largest error of plain Taylor series in double precision, in the quantities asked for."""
    plain = true_motion(scene, setting, "double", 100 * most)
    return _apart(scene, plain, true_motion(scene, setting, most=most))


def blur(scene: Scene, most=reference.MAX_SERIES) -> float:
    """How far the true motion may lie as the scene's numbers are rounded to doubles: by half a last place each.

    To a smaller accuracy the scene itself does not say how the body moves.
    """
    truth, total = true_motion(scene, AS_PLANNED, most=most), 0.0
    for name, values in reference.parameters_of(scene).items():
        for i in np.flatnonzero(values) if name != "pivot" else ():
            changed = np.array(values, float)
            changed[i] = np.nextafter(changed[i], np.inf)
            total += 0.5 * _apart(scene, true_motion(scene, Setting(changes={name: changed}), most=most), truth)
    return total


def _apart(scene: Scene, motion, truth) -> float:
    return max(errors({name: motion.high[name] for name in scene.outputs.quantities}, truth).values())


def pasted(scene: Scene, setting: Setting, note: str = "") -> str:
    """The scene in TOML with its setting in comments."""
    lines = [f"# {note}"] if note else []
    plain = {name: np.asarray(v, dtype=float).tolist() for name, v in setting.changes.items()}
    lines += [f"# setting: {replace(setting, changes=plain)}"]
    for table, values in scene.to_dict().items():
        if isinstance(values, dict):
            lines += [f"[{table}]", *(f"{k} = {_toml(v)}" for k, v in values.items())]
    return "\n".join(lines)


def _toml(value):
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value).replace("'", '"')
