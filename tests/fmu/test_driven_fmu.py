"""A driven FMU is a driven simulation: FMPy with the same table and steps gives the same bits, from both kinds."""

import fmpy
import numpy as np
import pytest

import rbfmu
import rbfmu_fmu
from tests.support.paths import SCENES

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


def test_linear_inputs_give_the_bits_of_fmpy_that_sets_input_derivatives(fmu, tmp_path):
    if not fmpy.read_model_description(str(fmu), validate=False).coSimulation.canInterpolateInputs:
        pytest.skip("pythonfmu takes no input derivatives")
    table = written(tmp_path / "u.csv")
    recorded = fmpy.simulate_fmu(
        str(fmu), start_time=0.0, stop_time=STOP, output_interval=STEP, input=fmpy.util.read_csv(table),
        set_input_derivatives=True, validate=False,
    )  # fmt: skip
    columns = rbfmu.simulate(satellite(), inputs=table, interpolate="linear").columns()
    for name in HELD:
        np.testing.assert_allclose(recorded[name], columns[name], rtol=0, atol=1e-14, err_msg=name)
    assert np.ptp(recorded[HELD[0]] - rbfmu.simulate(satellite(), inputs=table).columns()[HELD[0]]) > 1e-6
