"""The registry of models: what it says of each in plain Python is what the kernels do."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from rbfmu import load_scene
from rbfmu.models.question import Question
from rbfmu.models.registry import MODELS, lost_by_symmetry
from rbfmu.runs.plan import filled_buffer
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK
from tests.support.covering import some_of
from tests.support.paths import SCENES
from tests.support.scenes.model_cases import plan_by_hand
from tests.support.scenes.random_scenes import scenes

OF_BODIES = [spec for spec in MODELS.values() if "inertia" in spec.kernels.BLOCKS]
ULP = 2.0**-52
LEAST = 5e-324
LEANING = {"rotvec": [0.7, 0.0, 0.0]}
"""About x, so that what hangs beside x swings about it."""


def differing(scene):
    """Names of the models that the kernels take and the registry does not, or the other way round."""
    taken = {spec.key: spec.kernels.initialize(filled_buffer(scene, plan_by_hand(spec.key))) for spec in OF_BODIES}
    return [spec.key for spec in OF_BODIES if spec.accepts(Question(scene)) != (taken[spec.key] == OK)]


@pytest.mark.thorough
@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_registry_takes_what_the_kernels_take_in_the_gallery(path):
    scene = load_scene(path)
    assert scene.body is None or differing(scene) == []


@pytest.mark.thorough
@given(scenes())
@settings(max_examples=50, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
def test_the_registry_takes_what_the_kernels_take_at_random(scene):
    assert differing(scene) == []


def border(inertia, omega_b=(0.0, 0.0, 0.0), loads=None, asked=("quaternion", "omega_b"), **body):
    tables = {"body": {"mass": 2.0, "inertia": inertia} | body, "initial": {"omega_b": omega_b, "attitude": LEANING}}
    tables |= {"loads": {"gravity_a": [0.0, 0.0, 0.0]} | (loads or {}), "outputs": {"quantities": list(asked)}}
    return Scene.from_dict(tables | {"run": {"stop": 1.0}})


BEAM, DISC, BRICK = [0.0, 1.0, 1.0], [1.0, 1.0, 1.3], [1.0, 1.2, 1.4]
SPINS = {"at rest": (0.0, 0.0, 0.0), "about x": (1.0, 0.0, 0.0),
         "about z": (0.0, 0.0, 2.0), "nearly about z": (LEAST, 0.0, 2.0),
         "hardly": (0.0, 0.0, LEAST), "anyhow": (0.3, -0.2, 1.0)}  # fmt: skip
INERTIAS = {"beam": BEAM, "disc": DISC, "brick": BRICK, "ball": [0.7] * 3}
INERTIAS |= {f"disc, {k} ulp off": [1.0, 1.0 + k * ULP, 1.3] for k in (1, 2, 2**10, 2**12, 2**13, 2**20)}
INERTIAS |= {f"ball, {k} ulp off": [1.0, 1.0 - k * ULP, 1.0] for k in (1, 2**13)}
INERTIAS |= {"disc in other axes": [[1.1, 0.1, 0.1], [0.1, 1.1, 0.1], [0.1, 0.1, 1.1]]}
LOADS = {
    "none": {},
    "negative zeros": {"torque_b": [-0.0] * 3, "force_b": [-0.0] * 3},
    "least torque": {"torque_b": [0.0, 0.0, LEAST]},
    "least damping": {"damping_b": [0.0, LEAST, 0.0]},
    "motor": {"torque_b": [0.0, 0.0, 0.3], "damping_b": [0.1, 0.1, 0.2]},
    "motor, 1 ulp off": {"torque_b": [0.0, ULP, 0.3], "damping_b": [0.1, 0.1 + 2.0**-56, 0.2]},
    "brake": {"damping_b": [0.1, 0.0, 0.0]},
    "fixed in space": {"torque_a": [0.1, 0.0, 0.0]},
    "thrust": {"force_b": [0.0, 0.0, 1.0]},
    "thrust, aslant": {"force_b": [0.0, 16.0 * ULP, 1.0]},
    "force": {"force_a": [0.0, 0.0, -1.0]},
}
PLACES = {"at its centre": {}, "beside": {"r_oc_b": [0.0, 0.2, 0.0]}, "hardly beside": {"r_oc_b": [0.0, LEAST, 0.0]},
          "hung": {"pivot": True, "r_oc_b": [0.0, 0.3, 0.0]}, "held": {"pivot": True}}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("inertia", some_of([*INERTIAS], 5))
def test_the_registry_takes_what_the_kernels_take_at_borders(inertia, place):
    wrong = {}
    for spin, omega_b in SPINS.items():
        for name, loads in LOADS.items():
            loads = loads | ({"gravity_a": [0.0, 0.0, -9.8]} if place == "hung" else {})
            for asked in (["quaternion", "omega_b"], ["omega_b"], ["angular_momentum_a"], ["position"]):
                try:
                    scene = border(INERTIAS[inertia], omega_b, loads, asked, **PLACES[place])
                except ValueError:  # a scene that is refused before any model is asked
                    continue
                if found := differing(scene):
                    wrong[spin, name, *asked] = found
    assert wrong == {}


def test_what_symmetry_loses_does_not_hang_on_the_unit_of_inertia():
    """It is the difference of two moments beside the least one, in any unit."""
    M = np.array([[1.5, 0.5, 0.0], [0.5, 1.5 + 3e-11, 0.0], [0.0, 0.0, 1.0]])  # moments 1, 1 and 2, but for round-off
    one = Scene.from_dict({"body": {"mass": 1.0, "inertia": M.tolist()}, "initial": {"omega_b": [0.3, 1.2, 0.1]}})
    lost = [lost_by_symmetry(Question(one.replace({"body.inertia": (unit * M).tolist()}))) for unit in (1.0, 2.0**20)]
    assert lost[0] > 0.0
    assert lost[1] == pytest.approx(lost[0], rel=1e-3)


def test_an_energy_that_overflows_is_taken_by_neither():
    scene = border([1e9, 1.2e9, 1.4e9], (1e150, 1e150, 1e150), asked=["kinetic_energy"])
    assert differing(scene) == []
    assert not MODELS["torque-free body"].accepts(Question(scene))


def test_what_varies_is_not_served_by_what_rests_on_it():
    fixed = border(BRICK, (0.0, 0.0, 2.0))
    scene = fixed.replace(inputs={"parameters": ["omega_b_0"]})
    spinning, any_rate = MODELS["constant rate"], MODELS["torque-free body"]
    assert spinning.serves(Question(fixed))
    assert not spinning.serves(Question(scene))
    assert any_rate.serves(Question(scene))


@pytest.mark.thorough
def test_choosing_compiles_no_model():
    code = (
        "import rbfmu; from rbfmu.models.registry import MODELS; "
        f"rbfmu.plan({str(SCENES / 'fixed_camera.toml')!r}); "
        "print([key for key, spec in MODELS.items() if spec.kernels.initialize.signatures])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
