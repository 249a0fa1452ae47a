"""What tools show of an FMU: who made it and what it is, types, display units, usual sizes, words for components."""

import math
from functools import cache
from xml.etree import ElementTree

import fmpy
import pytest

import rbfmu
from rbfmu.scene.scene import Scene
from rbfmu_fmu.description import describe
from rbfmu_fmu.model_description import FMI2, FMI3, depends_on, model_description, version_of
from rbfmu_kernels.quantities import BY_NAME, UNITS
from tests.support.fmu.fmus import TABLES, built, planned, scene, unzipped

NAMES = ("brick", *TABLES)


@cache
def written(name):
    return ElementTree.parse(unzipped(name) / "modelDescription.xml").getroot()


def variables(name):
    return {v.get("name"): v for v in written(name).iter("ScalarVariable")}


def real(name, variable):
    return variables(name)[variable].find("Real")


def test_a_scene_s_own_words_are_shown():
    root = written("brick")
    assert root.get("generationTool") == f"rbfmu {rbfmu.__version__}"
    assert root.get("description") == scene("brick").about.description == "NASA's tumbling brick"
    assert root.get("license").startswith("MIT")
    assert root.get("author") is None
    about = {"description": "A <b> & c", "author": "Ann", "version": "1.2", "license": "mine"}
    made = describe(Scene.from_dict(TABLES["default"] | {"about": about}), planned("default"))
    root = model_description(FMI2, made, {})
    assert {key: root.get(key) for key in about} == about


def test_a_scene_without_words_is_one_rigid_body():
    assert written("default").get("description") == "One rigid body"


@pytest.mark.parametrize("name", NAMES)
def test_every_variable_has_the_declared_type_of_its_unit(name):
    types = {t.get("name"): t.find("Real").attrib for t in written(name).iter("SimpleType")}
    used = set()
    for v in variables(name).values():
        attributes = v.find("Real").attrib if v.find("Real") is not None else {"unit": "1"}
        declared = attributes.get("declaredType")
        assert (declared is None) == (attributes["unit"] == "1")
        if declared:
            used.add(declared)
            assert types[declared] == {k: x for k, x in attributes.items() if k in ("quantity", "unit", "displayUnit")}
            assert attributes["quantity"] == declared
    assert used == set(types)
    assert not used & set(variables(name))


def test_every_unit_but_1_measures_a_quantity_of_its_own():
    quantities = [unit.quantity for name, unit in UNITS.items() if name != "1"]
    assert all(quantities)
    assert len(set(quantities)) == len(quantities)


@pytest.mark.thorough
def test_a_unit_of_ones_own_is_the_known_one_of_that_name():
    """N m is N.m in FMI, where names of units are unique."""
    units = {"k": {"value": 0.5, "unit": "N.m"}, "c": {"value": 1.0, "unit": "m/K"}, "d": {"value": 1.0, "unit": "N m"}}
    given = {"constants": units, "loads": {"torque_b": "[k + d, c, 0]"}, "outputs": {"quantities": ["omega_b"]}}
    sprung = Scene.from_dict({"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}} | given)
    for version in (FMI2, FMI3):
        root = model_description(version, describe(sprung, rbfmu.plan(sprung)), {})
        names = [unit.get("name") for unit in root.iter("Unit")]
        assert len(set(names)) == len(names)
        assert {"N.m", "m/K"} <= set(names)
        assert [unit.get("name") for unit in root.iter("Unit") if unit.find("BaseUnit") is None] == ["m/K"]
        typed = {v.get("name"): v if version is FMI3 else v[0] for v in root.find("ModelVariables")}
        assert {typed[name].get("declaredType") for name in ("k", "d")} == {"Torque"}
        assert typed["c"].get("declaredType") is None


def test_angles_and_rates_are_shown_in_degrees():
    shown = {name: real("default", name).get("displayUnit") for name in ("rpy[1]", "omega_b[1]", "alpha_b[2]", "mass")}
    assert shown == {"rpy[1]": "deg", "omega_b[1]": "deg/s", "alpha_b[2]": "deg/s2", "mass": None}
    units = {unit.get("name"): unit for unit in written("default").iter("Unit")}
    factors = {one.get("name"): float(one.get("factor")) for one in units["rad/s"].iter("DisplayUnit")}
    assert factors == pytest.approx({"deg/s": 180.0 / math.pi, "rpm": 30.0 / math.pi}, rel=1e-15)
    of_angles = [v for v in variables("driven").values() if v[0].get("unit", "").startswith("rad")]
    assert all(v[0].get("displayUnit") in {one.get("name") for one in units[v[0].get("unit")]} for v in of_angles)


def test_components_have_words():
    words = {name: v.get("description").rpartition(": ")[2] for name, v in variables("driven").items()}
    assert [words[f"torque_b[{i}]"] for i in (1, 2, 3)] == ["x", "y", "z"]
    assert [words[f"rpy[{i}]"] for i in (1, 2, 3)] == ["roll", "pitch", "yaw"]
    assert [words[f"inertia[{i}]"] for i in ("1,1", "2,2", "3,3", "1,2", "1,3", "2,3")] == [
        *("xx", "yy", "zz", "xy", "xz", "yz")
    ]
    for name in ("quaternion", "quaternion_0"):
        found = [words[f"{name}[{i}]"] for i in (1, 2, 3, 4)]
        assert found == ["scalar part", "vector part x", "vector part y", "vector part z"]
    assert variables("driven")["mass"].get("description") == "mass"


@pytest.mark.parametrize("name", NAMES)
def test_descriptions_tell_variables_apart(name):
    words = [v.get("description") for v in variables(name).values()]
    assert len(set(words)) == len(words)


def test_nominal_values_are_sizes_at_the_start():
    nominal = {name: v.find("Real").get("nominal") for name, v in variables("driven").items() if name != "status"}
    assert nominal["mass"] == "2.0"
    assert nominal["position[3]"] == nominal["position_0[1]"] == "4.0"  # of (1, 2, 3), to one digit
    assert nominal["velocity[1]"] == "1.0"  # m/s: at least what the accuracy is relative to
    assert nominal["omega_b[2]"] == nominal["omega_a[2]"] == "0.4"
    assert nominal["force_a[1]"] == "2.0"  # 1 m/s2
    assert nominal["torque_b[1]"] == "2.0"  # 1 rad/s2 of the largest moment, 2.5
    assert nominal["gravity_a[1]"] == "10.0"
    assert float(nominal["angular_momentum_a[1]"]) > 0.1
    assert not any(nominal[name] for name in ("rpy[1]", "quaternion[2]", "alpha_b[1]", "acceleration[3]"))
    assert real("prescribed", "omega_b[1]").get("nominal") == "1.0"
    assert real("default", "omega_b[1]").get("nominal") is None  # it starts at rest


@pytest.mark.parametrize("name", NAMES)
def test_nominal_values_are_positive(name):
    found = [v.find("Real").get("nominal") for v in variables(name).values() if v.find("Real") is not None]
    assert all(float(x) > 0.0 for x in found if x is not None)


@pytest.mark.parametrize("name", NAMES)
def test_the_experiment_has_the_scene_s_accuracy_for_its_tolerance(name):
    assert float(fmpy.read_model_description(str(built(name))).defaultExperiment.tolerance) == scene(name).run.accuracy


def test_log_categories_are_described():
    categories = list(written("default").iter("Category"))
    assert len(categories) == 5
    assert all(category.get("description") for category in categories)


def test_a_scene_whose_variables_have_no_quantity_declares_no_types():
    still = scene("fixed_camera").replace({"outputs.quantities": ["quaternion"]})
    d = describe(still, rbfmu.plan(still))
    assert {v.block for v in d.variables} == {"quaternion", "quaternion_0"}
    assert model_description(FMI2, d, {}).find("TypeDefinitions") is None


EVERY = {"torque_b", "force_a", "force_b"}


@pytest.mark.parametrize(("pivot", "followed"), [
    (True, {"alpha_b": {"torque_b"}, "acceleration": set()}), (False, {"alpha_b": EVERY, "acceleration": EVERY}),
])  # fmt: skip
def test_forces_at_a_pivot_turn_nothing_at_once_and_nothing_moves_it(pivot, followed):
    """2026-11-29: no test found a pivot whose rates follow forces, an algebraic loop that is not there.

    2026-11-30: its acceleration, which is zero, was said to follow all loads.
    """
    one = Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.0, 0.1, -0.4], "pivot": pivot},
        inputs={"ports": ["force_a", "force_b", "torque_b"]}, outputs={"quantities": ["acceleration", "alpha_b"]},
    )  # fmt: skip
    d = describe(one, rbfmu.plan(one))
    assert {v.block: {d.variables[k].block for k in depends_on(d, v)} for v in d.outputs} == followed


@pytest.mark.parametrize("listed", [[], ["r_oc_b"]])
def test_a_centre_that_may_be_moved_couples_forces_and_torques(listed):
    """Where it lies at o and stays there they are apart."""
    one = Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, inputs={"ports": ["force_a", "torque_b"], "parameters": listed},
        outputs={"quantities": ["acceleration", "alpha_b"]},
    )  # fmt: skip
    d = describe(one, rbfmu.Plan("body under loads, by series", "", 13, tolerance=1e-6, order=12))
    found = {v.block: {d.variables[k].block for k in depends_on(d, v)} for v in d.outputs}
    both = {"force_a", "torque_b"} if listed else set()
    assert found == {"acceleration": {"force_a"} | both, "alpha_b": {"torque_b"} | both}


@pytest.mark.parametrize(("arm", "listed"), [(0.0, []), (0.1, []), (0.0, ["r_oc_b"])])
def test_what_turns_a_body_is_a_parameter_where_its_point_o_is_off_the_centre_or_may_be(arm, listed):
    one = Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.0, arm, 0.0]}, inputs={"parameters": listed},
        loads={"force_a": [1, 0, 0], "torque_b": [0, 0, 1]}, outputs={"quantities": ["acceleration"]},
    )  # fmt: skip
    found = {v.block for v in describe(one, rbfmu.plan(one)).variables if v.causality == "parameter"}
    turning = {"inertia", "torque_b", "omega_b_0", "quaternion_0", "r_oc_b"} if arm or listed else set()
    assert found == {"mass", "force_a", "gravity_a"} | turning


@pytest.mark.parametrize("moments", [[7.0, 4.0, 4.0], [4.0, 7.0, 4.0], [4.0, 4.0, 7.0]])
def test_a_torque_s_usual_size_is_of_the_largest_moment_about_whichever_axis(moments):
    one = Scene(
        body={"mass": 1.0, "inertia": moments}, inputs={"ports": ["torque_b"]}, outputs={"quantities": ["omega_b"]}
    )
    assert {v.nominal for v in describe(one, rbfmu.plan(one)).inputs} == {7.0}


# Of FMI 3, whose variables are arrays: as the file is made, without an FMU


@cache
def of_fmi_3():
    """A model description, and its variables by name: of a body on a pivot whose load reads the time, with an event."""
    one = Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.0, 0.1, -0.4], "pivot": True},
        loads={"torque_b": "[0, 0, 0.1*sin(t)]"}, inputs={"ports": ["torque_a"], "parameters": ["inertia"]},
        outputs={"quantities": ["rpy", "alpha_b"], "clock": "2*t"}, events={"trip": "omega_b[3] - 1"},
    )  # fmt: skip
    d = describe(one, rbfmu.plan(one))
    root = model_description(FMI3, d, {})
    return d, root, {v.get("name"): v for v in root.find("ModelVariables")}


def test_arrays_have_bounds_that_hold_for_each_number_and_matrices_no_words_for_them():
    _, root, named = of_fmi_3()
    assert (named["rpy"].get("min"), named["rpy"].get("max")) == (repr(-math.pi), repr(math.pi))
    assert named["rpy"].get("description").endswith(": roll, pitch, yaw")
    assert named["inertia"].get("description") == BY_NAME["inertia"].meaning
    assert named["trip_count"].get("min") == "0"
    degrees = next(unit for unit in root.iter("DisplayUnit") if unit.get("name") == "deg")
    assert float(degrees.get("factor")) == pytest.approx(180.0 / math.pi)


def test_what_outputs_follow_is_listed_in_order_with_the_time_and_counts_too():
    _, root, named = of_fmi_3()
    outputs = {one.get("valueReference"): one for one in root.find("ModelStructure").iter("Output")}
    assert set(outputs) == {v.get("valueReference") for v in named.values() if v.get("causality") == "output"}
    follows = {name: outputs[named[name].get("valueReference")].get("dependencies").split() for name in
               ("rpy", "alpha_b", "clock", "trip_count")}  # fmt: skip
    time, torque = (named[name].get("valueReference") for name in ("time", "torque_a"))
    expected = {"rpy": [], "clock": [time], "alpha_b": sorted([torque, time], key=int), "trip_count": []}
    assert follows == expected
    for one in root.find("ModelStructure"):
        references = [*map(int, one.get("dependencies").split())]
        assert references == sorted(references)


def test_the_time_has_its_unit_where_nothing_else_is_in_seconds():
    still = scene("fixed_camera").replace({"outputs.quantities": ["quaternion"]})
    root = model_description(FMI3, describe(still, rbfmu.plan(still)), {})
    assert "s" in {unit.get("name") for unit in root.iter("Unit")}
    time = next(v for v in root.find("ModelVariables") if v.get("name") == "time")
    assert (time.get("unit"), time.get("variability"), time.get("causality")) == ("s", "continuous", "independent")


def test_parameters_take_no_part_in_intermediate_updates_and_say_which_cannot_be_changed():
    d = describe(scene("two_ports"), planned("two_ports"))
    named = {v.get("name"): v for v in model_description(FMI3, d, {}).find("ModelVariables")}
    updated = {v.get("causality") for v in named.values() if v.get("intermediateUpdate") == "true"}
    assert updated == {"input", "output"}
    assert named["status"].get("intermediateUpdate") == "true"
    pinned = {v.block for v in d.variables if v.pinned}
    assert pinned
    assert {name for name, v in named.items() if "cannot be changed here" in (v.get("description") or "")} == pinned


@pytest.mark.parametrize("fmi", [2.0, "3", True, 4])
def test_versions_of_fmi_are_2_and_3(fmi):
    with pytest.raises(ValueError, match="expected 2 or 3"):
        version_of(fmi, False)
