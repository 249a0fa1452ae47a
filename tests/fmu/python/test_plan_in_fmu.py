"""What a plan means for an FMU: only the variables asked for, and no value that its model cannot serve."""

import numpy as np
import pytest

import rbfmu_fmu
from rbfmu import SceneError
from rbfmu.planning.select import plan
from rbfmu.scene.scene import Scene
from tests.support.fmu.fmu_importer import ERROR, OK, Fmu
from tests.support.fmu.fmus import unzipped_at
from tests.support.references import reference_mp as reference

pytestmark = pytest.mark.thorough
KINDS = pytest.mark.parametrize("kind", ["python", "native"])
NO_GRAVITY = {"gravity_a": [0.0, 0.0, 0.0]}
SATELLITE = {"mass": 500.0, "inertia": [120.0, 150.0, 200.0]}
RUN = {"stop": 20.0, "step": 0.5, "accuracy": 1e-9}


def spinning(spin=(0.0, 0.0, 0.4), wanted=("quaternion", "omega_b"), **inputs):
    """About a principal axis unless told otherwise."""
    return Scene(body=SATELLITE, initial={"omega_b": list(spin)}, loads=NO_GRAVITY, inputs=inputs,
                 outputs={"quantities": list(wanted)}, run=RUN)  # fmt: skip


def made(scene, folder, kind):
    """An FMU's library, in this process."""
    path = rbfmu_fmu.build(scene, folder / f"{kind}.fmu", kind)
    return Fmu(unzipped_at(path, folder / kind))


def started(fmu, spin):
    """An instance in initialisation, with another rate than the scene's."""
    instance = fmu.instance()
    assert instance.setup() == instance.enter() == OK
    assert instance.set({f"omega_b_0[{i + 1}]": w for i, w in enumerate(spin)}) == OK
    return instance


def said(instance):
    return " ".join(message[-1].decode() for message in instance.log)


@KINDS
def test_an_fmu_of_rates_alone_has_only_what_they_need(kind, tmp_path):
    fmu = made(spinning((0.1, 0.2, 0.4), ["omega_b"]), tmp_path, kind)
    assert {name.split("[")[0] for name in fmu.references} == {"inertia", "omega_b_0", "omega_b", "status"}
    assert not fmu.by_causality["input"]
    assert rbfmu_fmu.verify(tmp_path / f"{kind}.fmu").passed


@KINDS
def test_an_fmu_of_a_pushed_free_body_gives_the_kernels_bits(kind, tmp_path):
    tables = spinning((0.1, 0.2, 0.4), ["position"]).to_dict()
    tables["loads"]["force_b"] = [5.0, -3.0, 2.0]
    path = rbfmu_fmu.build(Scene.from_dict(tables), tmp_path / f"{kind}.fmu", kind)
    assert rbfmu_fmu.verify(path).passed


def test_a_plan_whose_model_refuses_the_scene_makes_no_fmu(tmp_path):
    """The FMU was written, and no importer could start it."""
    tables = spinning().to_dict()
    tables["loads"]["torque_b"] = [0.0, 0.0, 0.1]
    with pytest.raises(SceneError, match="expected loads without torque: this model"):
        rbfmu_fmu.build(Scene.from_dict(tables), tmp_path / "it.fmu", planned=plan(spinning((0.1, 0.2, 0.4))))
    assert not [*tmp_path.iterdir()]


@KINDS
def test_a_spin_off_the_principal_axis_is_refused_where_the_model_has_none(kind, tmp_path):
    instance = started(made(spinning(), tmp_path, kind), (0.1, 0.0, 0.4))
    assert instance.exit() >= ERROR
    assert "omega_b_0[1] = 0.1" in said(instance)
    assert 'list "omega_b_0" under parameters in the scene\'s [inputs] to vary it' in said(instance)


@KINDS
def test_another_spin_about_the_same_axis_is_served(kind, tmp_path):
    assert_right(started(made(spinning(), tmp_path, kind), (0.0, 0.0, -0.7)), (0.0, 0.0, -0.7))


@KINDS
def test_a_listed_spin_may_be_any(kind, tmp_path):
    fmu = made(spinning(parameters=["omega_b_0"]), tmp_path, kind)
    assert_right(started(fmu, (0.1, -0.2, 0.4)), (0.1, -0.2, 0.4))


@KINDS
def test_what_a_comparison_rests_on_is_held(kind, tmp_path):
    """A coning of some 1e-11 is dropped; so no rate may be changed, not even along the axis."""
    instance = started(made(spinning((1e-11, 0.0, 0.4)), tmp_path, kind), (1e-11, 0.0, 0.5))
    assert instance.exit() >= ERROR
    assert "omega_b_0[3] = 0.5: this FMU's model was planned for 0.4" in said(instance)


def assert_right(instance, spin):
    """Against 40-digit arithmetic."""
    names = [f"{block}[{i + 1}]" for block, size in (("quaternion", 4), ("omega_b", 3)) for i in range(size)]
    assert instance.exit() == OK, said(instance)
    times, rows = [0.0], [instance.get(*names)]
    for k in range(40):
        assert instance.step(0.5 * k, 0.5) == OK
        times.append(0.5 * (k + 1))
        rows.append(instance.get(*names))
    points = reference.motion(spinning(spin), times)
    found, zeros = np.array(rows), np.zeros((len(times), 3))
    errors = reference.errors(points, found[:, :4], found[:, 4:], zeros, zeros)
    assert max(errors["attitude"], errors["omega_b"]) <= 1e-9
