"""What changes of numbers make of the start of a motion's errors, and of its constants: against 50 digits."""

import pytest

import rbfmu
from rbfmu.models.model_buffer import BLOCKS, BodyAtStart
from rbfmu.models.varied import VariedModel, VariedStart
from rbfmu.sensitivities import columns_of
from rbfmu_kernels.quantities import elements
from tests.support.references import exact

INERTIA = [[1.0, 0.1, -0.05], [0.1, 2.0, 0.2], [-0.05, 0.2, 2.5]]
TABLES = {
    "body": {"mass": 2.3, "inertia": INERTIA, "r_oc_b": [0.3, -0.2, 0.1]},
    "initial": {"attitude": {"euler": "ZYX", "angles_deg": [25, -40, 70]}, "omega_b": [0.7, -0.4, 1.1]},
    "constants": {"k": 0.3, "v": [1.0, 2.0, 0.5]},
    "states": {"charge": {"start": 0.2, "rate": "-k*charge"}, "w": {"start": [0.1, 0.2, 0.3], "rate": "v - w"}},
    "loads": {"torque_b": "-k*omega_b + 0.1*w", "gravity_a": [0.0, 0.3, -9.81]},
}
MOVING = {"position": [1.0, -2.0, 3.0], "velocity": [0.4, -0.5, 0.6]}
KEYS = ["body.mass", "body.inertia", "body.r_oc_b", "initial.omega_b", "initial.attitude", "initial.position",
        "loads.gravity_a", "constants.k", "constants.v", "states.charge", "states.w"]  # fmt: skip
STEP = exact.mp.mpf("1e-20")
"""Of the differences: their error is its square."""


def scene_of(pivot):
    """A body that is free, or hung up; what its loads read matters to all outputs."""
    body, initial = TABLES["body"] | {"pivot": pivot}, TABLES["initial"] | ({} if pivot else MOVING)
    return rbfmu.Scene.from_dict(TABLES | {"body": body, "initial": initial})


def columns_by(scene, keys):
    return [column for key in keys for column in columns_of(scene, key)]


def parameters_of(scene):
    """All numbers that may vary, by their names, in 50 digits."""
    z = BodyAtStart(scene).z
    names = ("mass", "inertia", "r_oc_b", "omega_b_0", "position_0", "velocity_0", "gravity_a")
    found = {name: z[BLOCKS[name]].tolist() for name in names} | {"rotvec_b": [0.0] * 3}
    found |= {f"constants.{name}": row.value for name, row in scene.constants.items()}
    found |= {f"states.{name}_0": row.start for name, row in scene.states.items()}
    numbers = {element: x for name, row in found.items() for element, x in _by_element(name, row)}
    return {element: exact.mp.mpf(x) for element, x in numbers.items()}


def begun(p, q, pivot):
    """What a motion begins with, and hangs on, by the textbook."""
    row = lambda name: [p[f"{name}[{i}]"] for i in (1, 2, 3)]  # noqa: E731
    u, r, omega = row("rotvec_b"), row("r_oc_b"), row("omega_b_0")
    R = exact.product(exact.matrix_from_quaternion(q), exact.combine((1, exact.mp.eye(3).tolist()), (1, exact.skew(u))))
    xx, yy, zz, xy, xz, yz = (p[f"inertia[{i}]"] for i in range(1, 7))
    M = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    S = exact.skew(r)
    M = exact.combine((1, M), (-p["mass"], exact.product(S, S))) if pivot else M
    found = {"omega": omega, "rotvec_b": u, "M": M, "M_inverse": (exact.mp.matrix(M) ** -1).tolist()}
    found["arm"] = r if pivot else exact.scaled(-1, r)
    found["r_c"] = exact.add(row("position_0"), exact.apply(R, r))
    if not pivot:
        found["inverse_mass"] = 1 / p["mass"]
        found["v_c"] = exact.add(row("velocity_0"), exact.apply(R, exact.cross(omega, r)))
    numbers = {e: x for name, value in found.items() for e, x in _by_element(name, value)}
    starts = {name.replace("_0", ""): x for name, x in p.items() if name.startswith("states.")}
    return p | numbers | starts


def _by_element(name, value):
    numbers = exact.flat(value)
    return zip(elements(name, len(numbers)), numbers, strict=True)


@pytest.mark.parametrize("pivot", [False, True])
def test_what_a_motion_begins_with_changes_as_its_parameters_do(pivot):
    scene = scene_of(pivot)
    columns = columns_by(scene, KEYS if pivot else [*KEYS, "initial.velocity"])
    z, p = BodyAtStart(scene).z, parameters_of(scene)
    found, q = VariedStart(scene, columns).at(z), exact.unit(exact.exact(z[BLOCKS["quaternion_0"]]))
    for n, column in enumerate(columns):
        after, before = (begun(p | {column.element: p[column.element] + h}, q, pivot) for h in (STEP, -STEP))
        for name in after:
            if pivot and name.startswith("r_c"):
                continue
            slope = float((after[name] - before[name]) / (2 * STEP))
            assert (found[name][n] if name in found else 0.0) == pytest.approx(slope, rel=1e-12, abs=1e-15), (
                name, column.name)  # fmt: skip


def test_numbers_that_are_zero_at_first_vary_as_others_do():
    """A model made of a body without products of inertia, hung up at its centre, serves those with."""
    tables = TABLES | {"body": {"mass": 2.3, "inertia": [1.0, 2.0, 2.5], "pivot": True}}
    zero = rbfmu.Scene.from_dict(tables)
    other = zero.replace({"body.inertia": INERTIA, "body.r_oc_b": [0.3, -0.2, 0.1]})
    keys = ["body.mass", "body.inertia[1,1]", "body.inertia[1,2]", "body.inertia[1,3]", "body.r_oc_b"]
    seeded = [set(VariedModel(one, columns_by(one, keys)).seeded) for one in (zero, other)]
    assert seeded[0] == seeded[1]
    assert {f"M_inverse[{i}]" for i in range(1, 10)} <= {name for name, _ in seeded[0]}


def test_what_stays_zero_has_no_derivatives():
    """Of a body in its principal axes, which moments alone change."""
    scene = rbfmu.Scene.from_dict(TABLES | {"body": {"mass": 2.3, "inertia": [1.0, 2.0, 2.5]}})
    model = VariedModel(scene, columns_by(scene, ["body.inertia"]))
    changing = {(f"{name}[{4 * n + 1}]", n) for name in ("M", "M_inverse") for n in range(3)}
    assert set(model.seeded) == changing | {(f"inertia[{n + 1}]", n) for n in range(3)}
    assert "inverse_mass" not in model.given.symbolic
