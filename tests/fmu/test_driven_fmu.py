"""A driven FMU is a driven simulation: by the same table and steps, and in the campaign, the same bits."""

import fmpy
import numpy as np
import pytest

import rbfmu
import rbfmu_fmu
from rbfmu.planning.select import plan
from rbfmu.scene.scene import SceneError
from tests.support.fmu.fmu_importer import OK, Fmu
from tests.support.fmu.fmus import unzipped_at
from tests.support.paths import SCENES
from tests.support.quadruple import reference
from tests.support.quadruple.campaign import FAILED, offered_by, verdict_of
from tests.support.quadruple.driving import Outcome, seen, true_motion
from tests.support.quadruple.errors import errors
from tests.support.quadruple.importing import seen_by_importer
from tests.support.quadruple.scenes import random_scene
from tests.support.quadruple.settings import random_settings

STEP, STOP = 0.125, 10.0
ROWS = 81
HELD = ("quaternion[1]", "quaternion[4]", "omega_b[2]")


@pytest.fixture(scope="module", params=["python", "native"])
def fmu(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("driven") / "satellite.fmu"
    return rbfmu_fmu.build(satellite(), path, kind=request.param)


def satellite():
    return rbfmu.load_scene(SCENES / "controlled_satellite.toml").replace(run={"step": STEP, "stop": STOP})


def written(path):
    """A table with a row at each communication point."""
    values = np.random.default_rng(3).normal(scale=0.05, size=(ROWS, 3))
    rows = np.column_stack([STEP * np.arange(ROWS), values])
    names = ("time", *(f"torque_b[{k}]" for k in (1, 2, 3)))
    path.write_text(",".join(names) + "\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist()) + "\n")
    return path


@pytest.mark.thorough
def test_held_inputs_give_the_bits_of_fmpy_with_the_same_file(fmu, tmp_path):
    table = written(tmp_path / "u.csv")
    recorded = fmpy.simulate_fmu(
        str(fmu), start_time=0.0, stop_time=STOP, output_interval=STEP, input=fmpy.util.read_csv(table), validate=False
    )
    columns = rbfmu.simulate(satellite(), inputs=table).columns()
    assert len(recorded) == ROWS
    for name, values in columns.items():
        np.testing.assert_array_equal(recorded[name], values, err_msg=name)
    assert np.ptp(recorded[HELD[0]]) > 0.01


@pytest.mark.thorough
def test_linear_inputs_give_the_bits_of_an_importer_that_gives_input_derivatives(tmp_path):
    path = rbfmu_fmu.build(satellite(), tmp_path / "satellite.fmu", kind="native")
    unit = Fmu(unzipped_at(path, tmp_path / "unzipped")).started()
    table = fmpy.util.read_csv(written(tmp_path / "u.csv"))
    columns = rbfmu.simulate(satellite(), inputs=tmp_path / "u.csv", interpolate="linear").columns()
    ports = [f"torque_b[{k}]" for k in (1, 2, 3)]
    for k in range(ROWS - 1):
        assert unit.set({port: table[port][k] for port in ports}) == OK
        assert unit.set_rates({port: (table[port][k + 1] - table[port][k]) / STEP for port in ports}) == OK
        assert unit.step(STEP * k, STEP) == OK
        assert unit.get(*HELD) == [columns[name][k + 1] for name in HELD]
    held = rbfmu.simulate(satellite(), inputs=tmp_path / "u.csv").columns()
    assert np.max(np.abs(held[HELD[0]] - columns[HELD[0]])) > 1e-6


# The campaign's settings


@pytest.mark.slow
@pytest.mark.skipif(reference.library() is None, reason="no C compiler with quadruple precision")
@pytest.mark.parametrize("kind", ["python", "native"])
@pytest.mark.parametrize("seed", range(700_000, 700_018))
def test_an_fmu_answers_as_the_unit_and_rightly(kind, seed, tmp_path):
    try:
        _, scene = random_scene(seed)
        planned = plan(scene)
    except SceneError as error:
        pytest.skip(f"no plan: {error}")
    fmu = Fmu(unzipped_at(rbfmu_fmu.build(scene, tmp_path / "it.fmu", kind), tmp_path / "it"))
    offered = offered_by(scene, planned)
    for label, setting in random_settings(seed, scene, offered):
        refused, rows = seen(scene, planned, setting)
        said, got = seen_by_importer(fmu, scene, setting)
        assert bool(refused) == bool(said), (label, setting, refused, said)
        assert all(np.array_equal(got[name], values) for name, values in rows.items()), (label, setting)
        found = Outcome(said) if said else Outcome("", errors(got, true_motion(scene, setting)))
        verdict, _, text = verdict_of(scene, setting, found)
        assert verdict not in FAILED, (label, setting, text)
