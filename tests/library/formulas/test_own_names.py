"""Names of one's own: constants and starts as parameters, outputs, ports, and what they may not be called or be."""

import copy
import math
import pickle

import numpy as np
import pytest

import rbfmu
from rbfmu.runs.steps import motion_of
from tests.library.formulas.test_scenes import scene
from tests.support.scenes.balls import ball


def test_an_output_that_is_zero_but_for_round_off_is_named():
    """2026-11-27: "the motion magnifies round-off ... ask for a shorter run" was said of how far an energy drifts."""
    tables = scene(loads={"torque_b": "cross(omega_b, [0, 0, 1])"}, initial={"omega_b": [1.0, 2.0, 0.3]})
    tables |= {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "run": {"stop": 1.0, "step": 0.5}}
    tables["outputs"] = {"quantities": ["omega_b"], "drift": "dot(omega_b, M_c @ omega_b) - 9.225"}
    for more in ({}, {"inputs": {"ports": ["torque_b"]}}):
        with pytest.raises(rbfmu.SceneError, match=r"reach \S+, of outputs\.drift \(at most .*all else meets it"):
            rbfmu.plan(rbfmu.Scene.from_dict(tables | more))


POTENTIAL = {"potential": "0.5*k*dot(position, position)", "force_a": [0.1, 0.2, -0.3]}


@pytest.mark.thorough
@pytest.mark.parametrize("load", ["force_a", "torque_b"])
@pytest.mark.parametrize("loads", [POTENTIAL, {"force_a": "-k*position", "torque_b": "-k*omega_b"}])
def test_loads_that_are_formulas_are_no_parameters(load, loads):
    """Values that were set for them, or varied, were left out without a word; so was what a potential adds to."""
    tables = scene(constants={"k": 3.0}, loads=loads, outputs={"quantities": ["position", "omega_b"]})
    vary = {f"loads.{load}": {"uniform": [[0.0] * 3, [1.0] * 3]}}
    for more in ({"inputs": {"parameters": [load]}}, {"ensemble": {"runs": 2, "vary": vary}}):
        with pytest.raises(rbfmu.SceneError, match="formulas or a potential make this one"):
            rbfmu.Scene.from_dict(tables | more)
    one = rbfmu.Scene.from_dict(tables)
    with pytest.raises(rbfmu.SceneError, match=f"{load}.*formulas or a potential make"):
        rbfmu.Simulator(one, **{load: [1.0, 0.0, 0.0]})
    with pytest.raises(ValueError, match="formulas or a potential make"):
        rbfmu.sensitivity(one, [f"loads.{load}"])


def test_a_force_beside_a_potential_is_that_of_the_scene_whose_plan_it_is_not_and_counts_in_the_energy():
    """Kernels of one scene ran another's force, and the energy had the force of both: no plan met the accuracy."""
    body, initial = {"mass": 2.0, "inertia": [1.0, 1.2, 1.5]}, {"position": [0.5, 0.3, -0.2]}
    one = rbfmu.Scene.from_dict(scene(body, initial, quantities=("position", "total_energy"), constants={"k": 3.0},
                                      loads=POTENTIAL))  # fmt: skip
    planned = rbfmu.plan(one)
    for two in (one, one.replace({"loads.force_a": [1.0, 0.0, 0.0]})):
        found = rbfmu.simulate(two, planned=planned)
        middle, swing = np.array(two.loads.force_a) / 3.0, math.sqrt(3.0 / two.body.mass)
        exact = middle + np.outer(np.cos(swing * found.time), np.array([0.5, 0.3, -0.2]) - middle)
        np.testing.assert_allclose(found.position, exact, rtol=0, atol=10.0 * two.run.accuracy)
        np.testing.assert_allclose(found.total_energy, found.total_energy[0], rtol=1e-6)


def test_names_of_ones_own_are_not_mistaken_for_those_of_a_body():
    names = {"constants": {"M": 2.0, "arm": 0.5}, "states": {"q": {"start": 0.1, "rate": "-M*q"},
             "omega": {"start": [0.1, 0.2, 0.3], "rate": "-arm*omega"}}}  # fmt: skip
    loads = {"torque_b": "[M*q, arm*q, 0] - omega"}
    plain = {"constants": {"a": 2.0, "b": 0.5}, "states": {"x": {"start": 0.1, "rate": "-a*x"},
             "y": {"start": [0.1, 0.2, 0.3], "rate": "-b*y"}}}  # fmt: skip
    one = rbfmu.simulate(rbfmu.Scene.from_dict(scene(loads=loads, outputs={"shown": "q"}, **names)))
    loads = {"torque_b": "[a*x, b*x, 0] - y"}
    other = rbfmu.simulate(rbfmu.Scene.from_dict(scene(loads=loads, outputs={"shown": "x"}, **plain)))
    np.testing.assert_array_equal(one.omega_b, other.omega_b)
    np.testing.assert_array_equal(one.shown, other.shown)
    np.testing.assert_allclose(one.shown, 0.1 * np.exp(-2.0 * one.time), rtol=0, atol=1e-10)
    with pytest.raises(rbfmu.SceneError, match="another name"):
        rbfmu.Scene.from_dict(scene(loads={"torque_b": "-omega_b"}, outputs={"arm": "t"}))


@pytest.mark.parametrize("name", ["gravity_a", "damping_b"])
def test_loads_that_no_formula_makes_say_which_ones_may_be(name):
    """2026-11-27: "expected 3 numbers" alone, where the page said that a load may be a formula."""
    with pytest.raises(rbfmu.SceneError, match=rf"^scene: loads\.{name} = .* as formulas make force_a, .* alone$"):
        rbfmu.Scene.from_dict(scene(loads={name: "t*[0, 0, 1]"}))


def test_ports_have_the_order_of_the_scene():
    """2026-11-27: those of one's own stood last, and so a controller's numbers drove other ports, without a word."""
    u, v = ({"name": name, "start": 0.0, "size": 1} for name in "uv")
    one = rbfmu.Scene.from_dict(scene(inputs={"ports": [u, "torque_b", v, "force_a"]}, loads={}))
    assert one.inputs.ports == ("u", "torque_b", "v", "force_a")
    assert one.to_dict()["inputs"]["ports"] == [u, "torque_b", v, "force_a"]
    assert rbfmu.Scene.from_dict(one.to_dict()) == one


def test_ports_of_ones_own_enter_formulas():
    ports = ["torque_b", {"name": "wheel", "unit": "N m", "start": [0.01, 0, 0]}, {"name": "u", "size": 1}]
    loads = {"torque_b": "-wheel - cross(omega_b, h) + [0, 0, u]"}
    states = {"h": {"start": [0, 0, 0], "rate": "wheel"}}
    driven = scene(inputs={"ports": ports}, loads=loads, states=states, outputs={"shown": "h"})
    one = rbfmu.Scene.from_dict(driven)
    assert rbfmu.Scene.from_dict(one.to_dict()) == one
    planned = rbfmu.plan(one)
    t = np.linspace(0.0, 5.0, 101)
    given = {"wheel": np.outer(t, [0.1, 0.2, -0.1]), "u": 0.3 * t}
    found = rbfmu.simulate(one, planned=planned, inputs=given, interpolate="linear")
    loads = {"torque_b": loads["torque_b"].replace("wheel", "w").replace("[0, 0, u]", "[0, 0, 0.3*t]")}
    states = {"h": {"start": [0, 0, 0], "rate": "w"}}
    formulas = {"w": "t*[0.1, 0.2, -0.1]"}
    same = rbfmu.simulate(rbfmu.Scene.from_dict(scene(loads=loads, states=states, formulas=formulas)))
    np.testing.assert_allclose(found.omega_b, same.omega_b, rtol=0, atol=1e-8)
    held = rbfmu.simulate(one, planned=planned)
    np.testing.assert_allclose(held.shown[-1], [0.05, 0.0, 0.0], rtol=1e-13, atol=1e-15)
    simulator = rbfmu.Simulator(one)
    simulator.step(u=0.3, wheel=[0.1, 0.0, 0.0])
    before = simulator.save()
    for wrong in ({"u": [1.0, 2.0]}, {"u": math.nan}, {"wheel": 1.0}, {"v": 1.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            simulator.step(**{"torque_b": [0.5, 0.0, 0.0], **wrong})
    assert simulator.save() == before


@pytest.mark.parametrize("ports", [[], ["torque_b"]])
def test_no_accuracy_below_round_off_is_promised(ports):
    """1e-15 was, and beside ports 1e-20, with an error of 1e-15: round-off that the motion magnifies was its excuse."""
    one = scene(inputs={"ports": ports}, loads={"torque_b": "-omega_b*norm(omega_b)"})
    with pytest.raises(rbfmu.SceneError, match=r"accuracy = 1e-15: expected at least 1\.0e-14, what double"):
        rbfmu.plan(rbfmu.Scene.from_dict(one).replace({"run.accuracy": 1e-15}))


def test_outputs_of_ones_own_hide_no_attribute_of_results_and_simulators():
    one = rbfmu.Scene.from_dict(scene(loads={"torque_b": "-omega_b"}))
    both = rbfmu.simulate(one), rbfmu.Simulator(one)
    names = {name for found in both for name in dir(found)}
    assert {"time", "rows", "until", "buffer", "_z", "__class__"} <= names
    for name in names - {"quantities"}:  # which is a key
        with pytest.raises(rbfmu.SceneError, match=rf"outputs\.{name}: expected another name"):
            rbfmu.Scene.from_dict(scene(loads={"torque_b": "-omega_b"}, outputs={name: "t"}))


@pytest.mark.parametrize("name", ["reach", "begun"])
def test_an_output_may_be_called_as_what_series_keep(name):
    """Its value stood for theirs: a motion with corners was refused."""
    found = rbfmu.simulate(ball("where(t > 1/3, 1, -1)", 1.0, 0.1, 1e-8, outputs={name: "2 + 3*t"}))
    np.testing.assert_allclose(getattr(found, name), 2.0 + 3.0 * found.time, rtol=1e-14)
    assert found.omega_b[-1, 2] == pytest.approx(1.0 / 3.0, rel=0, abs=1e-8)


def test_other_keys_of_a_row_stay_when_one_is_replaced_and_none_takes_a_row_away():
    one = ball(
        constants={"c": {"value": 2.0, "unit": "1/s"}}, states={"u": {"start": 1.0, "rate": "-c*u", "unit": "m"}},
        events={"half": {"when": "u - 0.5", "direction": "falling"}}, outputs={"level": {"value": "u", "unit": "m"}},
    )  # fmt: skip
    for changes in ({"outputs.level.value": "2*u"}, {"outputs.level": "2*u"}, {"outputs": {"level": "2*u"}}):
        level = one.replace(changes).outputs.own["level"]
        assert (level.value, level.unit) == ("2*u", "m")  # 2026-11-25: the unit was lost
    other = one.replace({"states.u.start": 3.0, "constants.c.value": 4.0, "events.half.direction": "any"})
    assert (other.states["u"].start, other.states["u"].rate, other.states["u"].unit) == ((3.0,), "-c*u", "m")
    for row in (other, one.replace({"constants.c": 4.0})):
        assert (row.constants["c"].value, row.constants["c"].unit) == ((4.0,), "1/s")
    assert (other.events["half"].when, other.events["half"].direction) == ("u - 0.5", "any")
    kept = ball(constants={"c": {"value": 2.0, "unit": "1/s"}}, events={"half": {"when": "t", "direction": "falling"}})
    assert one.replace({"outputs.level": None, "states.u": None, "events.half": "t"}) == kept
    assert kept.replace({"constants.c": None, "events.half": None}) == ball()
    for key in ("constants.d", "outputs.lvel", "run.step"):
        with pytest.raises(rbfmu.SceneError, match=rf"{key}(\.value)? = None: "):
            one.replace({key: None})


def test_tables_of_one_s_own_are_frozen_as_all_of_a_scene_is():
    """Those of a scene that has none were one table of all such scenes, so that writing gave it to all of them."""
    plain = rbfmu.Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 3.0]})
    own = plain.replace(constants={"k": 2.0})
    for table in (plain.constants, own.constants, own.inputs.own, own.loads.formulas):
        for write in (lambda t: t.update(k=3.0), lambda t: t.__setitem__("k", 3.0), lambda t: t.pop("k", None)):
            with pytest.raises(ValueError, match="frozen: Scene"):
                write(table)
    for same in (copy.copy(own), copy.deepcopy(own), pickle.loads(pickle.dumps(own))):
        assert same == own
        assert same.constants["k"].value == (2.0,)


@pytest.mark.parametrize(("start", "said"), [(0.0, "inputs at zero"), (0.2, "inputs at their start")])
def test_a_plan_says_with_which_inputs_its_pilot_ran(start, said):
    one = ball("u", inputs={"ports": [{"name": "u", "size": 1, "start": start}]})
    assert any(f"in a pilot run with {said}, " in reason for reason in rbfmu.plan(one).reasons)


@pytest.mark.thorough
def test_ports_and_constants_that_nothing_reads_can_be_set():
    """Where nothing else was a formula no model had places for them: a `KeyError` came of each of these."""
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "initial": {"omega_b": [0.1, 0.2, 0.3]},
              "constants": {"c": 2.0}, "run": {"stop": 1.0, "step": 0.5}}  # fmt: skip
    unlisted, listed = (rbfmu.Scene.from_dict(tables | {"inputs": inputs}) for inputs in ({}, {"parameters": ["c"]}))
    ports = [{"name": "u", "size": 1, "start": 3.0}]
    driven = rbfmu.Scene.from_dict(tables | {"inputs": {"ports": ports}})
    assert rbfmu.plan(listed).model == rbfmu.plan(unlisted).model == "torque-free body"
    plain = rbfmu.simulate(unlisted)
    for one in (rbfmu.Simulator(unlisted, c=3.0), rbfmu.Simulator(listed, c=3.0)):
        one.step(1.0)
        np.testing.assert_array_equal(one.quaternion, plain.quaternion[-1])
    found = rbfmu.simulate(driven, inputs={"u": ([0.0, 1.0], [1.0, 2.0])})
    np.testing.assert_allclose(found.quaternion, plain.quaternion, rtol=0, atol=1e-6)
    with pytest.raises(rbfmu.SceneError, match="another name: mass means something else"):
        rbfmu.Scene.from_dict(tables | {"constants": {"mass": 2.0}})


@pytest.mark.parametrize("quantities", [["omega_b"], ["quaternion", "position"]])
def test_a_chain_of_filters_begins_at_rest(quantities):
    """The third begins with t**3, and a body that it drives with t**4: of all states what comes first was zero."""
    lags = {"a": {"start": 0.0, "rate": "1 - a"}, "b": {"start": 0.0, "rate": "a - b"}}
    tables = {"states": lags | {"c": {"start": 0.0, "rate": "b - c"}}, "outputs": {"last": "c"}}
    loads = {"gravity_a": [0.0] * 3, "torque_b": "c*[0, 0, 1]", "force_a": "c*[1, 0, 0]"}
    found = rbfmu.simulate(ball(accuracy=1e-10, shows=quantities, loads=loads, **tables))
    t = found.time
    np.testing.assert_allclose(found.last, 1.0 - np.exp(-t) * (1.0 + t + t * t / 2.0), rtol=0.0, atol=1e-10)
    if "omega_b" in quantities:
        rates = t - 3.0 + np.exp(-t) * (3.0 + 2.0 * t + t * t / 2.0)
        np.testing.assert_allclose(found.omega_b[:, 2], rates, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("drive", ["x", pytest.param("cos(2*pi*t)", marks=pytest.mark.thorough)])
def test_what_swings_may_be_shown_where_it_comes_to_zero(drive):
    """2026-11-27: round-off at communication points was an error of over 100 %: "the motion magnifies round-off"."""
    tables = {"states": {"x": {"start": 0.0, "rate": "cos(2*pi*t)"}}, "outputs": {"o": "x"}}
    found, swung = rbfmu.simulate(ball(drive, 3.0, **tables)), 2.0 * math.pi
    rates = (1.0 - np.cos(swung * found.time)) / swung**2 if drive == "x" else 0.0 * found.time
    np.testing.assert_allclose(found.omega_b[:, 2], rates, rtol=0.0, atol=1e-6 / swung)
    np.testing.assert_allclose(found.o, 0.0, rtol=0.0, atol=1e-6 / swung)


@pytest.mark.parametrize(("sign", "cosine"), [(1.0, "R_ab[3,3]"), (-1.0, "clip(R_ab[3,3], -1, 1)")])
def test_a_cosine_in_R_ab_keeps_its_digits_where_it_is_one(sign, cosine):
    """2026-11-28: 1.5e-8 for any tilt below that; an event of it beside a port was refused after three minutes."""
    tilt = {"value": f"acos({cosine})"}
    for angle in (1e-12, 1e-7, 0.3, 1.2):
        turn = angle if sign > 0.0 else math.pi - angle
        attitude = {"quaternion": [math.cos(turn / 2), math.sin(turn / 2), 0.0, 0.0]}
        found = rbfmu.simulate(rbfmu.Scene(
            body={"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, initial={"attitude": attitude},
            outputs={"quantities": ["quaternion"], "tilt": tilt, "dip": "asin(R_ab[3,3])"},
            run={"stop": 0.1, "step": 0.1},
        ))  # fmt: skip
        np.testing.assert_allclose(found.tilt, turn, rtol=4e-16)
        np.testing.assert_allclose(math.pi / 2 - found.dip, turn, rtol=4e-16, atol=2e-16)


def test_an_event_may_watch_how_far_a_body_at_rest_tilts():
    scene = rbfmu.Scene(
        body={"mass": 12.0, "inertia": [0.9, 1.1, 1.4]}, inputs={"ports": ["torque_b"]},
        outputs={"quantities": ["omega_b"], "tilt": "acos(R_ab[3,3])"}, events={"flipped": "tilt - 30*deg"},
        run={"stop": 4.0, "step": 0.1},
    )  # fmt: skip
    assert rbfmu.plan(scene).error < 1e-12
    found = rbfmu.simulate(scene, {"torque_b": np.tile([0.09, 0.0, 0.0], (40, 1))})
    expected = math.sqrt(2.0 * math.pi / 6.0 / 0.1)  # of a tilt 0.1 t^2 / 2
    assert found.events["flipped"].tolist() == pytest.approx([expected], rel=1e-8)


BODY = {"body": {"mass": 1.0, "inertia": [1.0, 1.5, 2.0]}}
PORT = {"inputs": {"ports": [{"name": "u", "size": 1}]}}
TRIP = {"events": {"trip": "omega_b[1] - 1"}}
SPRING = {"loads": {"potential": "dot(position, position)"}, "outputs": {"quantities": ["total_energy"]}}


@pytest.mark.parametrize(("tables", "said"), [
    (PORT | {"outputs": {"u_rate_2": "2*u"}}, r"outputs\.u_rate_2: expected another name: u_rate_2 means"),
    (TRIP | {"constants": {"trip_time": 1.0}}, r"constants\.trip_time: .* name: that is an FMU's of events\.trip"),
    (TRIP | {"formulas": {"trip_count": "t"}}, r"formulas\.trip_count: .* name: that is an FMU's of events\.trip"),
    # 2026-12-01: a formula that read this constant was given the energy
    ({"constants": {"total_energy": 3.0}, "outputs": {"e": "total_energy"}}, r"constants\.total_energy: .* means some"),
    ({"outputs": {"potential_energy": "2*t"}}, r"outputs\.potential_energy: .* means something else"),
    ({"outputs": {"two": "[1, 2]"}}, r"outputs\.two\.value: expected a scalar or a vector of 3 numbers"),
    ({"loads": {"potential": "t*position[1]"}}, r"loads\.potential: expected a formula of position and attitude"),
    (SPRING | {"inputs": {"ports": ["torque_b"]}}, r"expected no total_energy: torque_b has no potential"),
    ({**SPRING, "loads": SPRING["loads"] | {"damping_b": [0, 1, 0]}}, r"no total_energy: damping_b has no potential"),
    ({**SPRING, "loads": SPRING["loads"] | {"force_b": [0, 1, 0]}}, r"no total_energy: force_b has no potential"),
    *(({"inputs": {"ports": [port]}}, said) for port, said in (
        ({"size": 3}, r"ports\.name is missing"), ({"name": "u", "size": 2}, r"ports\.u\.size = 2: .* 1 or 3"),
        ({"name": "u", "size": 1, "start": [1, 2, 3]}, r"ports\.u\.start = .* as many numbers"),
        ({"name": "t"}, "another name"), ({"name": "mass"}, "another name"), ({"name": "2u"}, "letters, digits"),
    )),
    ({"body": None, "inputs": {"ports": [{"name": "omega_b", "size": 3}]}},  # it was taken for that of the rates too
     r"inputs\.ports\.omega_b: expected another name: omega_b means"),
])  # fmt: skip
def test_what_means_something_else_or_cannot_be_is_refused(tables, said):
    with pytest.raises(rbfmu.SceneError, match=said):
        rbfmu.Scene(**BODY | tables)


BALANCED = {"inertia": [[1.0, 0.125, 0.0], [0.125, 1.5, 0.0], [0.0, 0.0, 2.0]], "r_oc_b": [0.25, 0.5, 0.0]}
"""Of 1 kg on a pivot at o, about which no product of inertia is left."""


@pytest.mark.parametrize(("listed", "value", "body"), [
    ("r_oc_b", [0.1, -0.2, 0.3], {}), ("r_oc_b", [0.1, -0.2, 0.3], {"pivot": True}),
    ("mass", 3.0, BALANCED | {"pivot": True}), ("inertia", [[2.0, 0.1, 0.2], [0.1, 2.5, 0.3], [0.2, 0.3, 3.0]], {}),
])  # fmt: skip
def test_formulas_hold_for_other_values_of_parameters_that_are_listed(listed, value, body):
    """Also where a number is zero in the scene, of which no formula would have a term."""
    scene = rbfmu.Scene.from_dict({
        "body": BODY["body"] | body, "initial": {"omega_b": [0.1, 0.2, 0.3]},
        "loads": {"gravity_a": [1, 0, -1], "force_b": [0.0 if body else 0.1, 0, 0], "torque_b": "-0.1*omega_b"},
        "inputs": {"parameters": [listed]}, "outputs": {"quantities": ["omega_b"]}, "run": {"stop": 1.0, "step": 0.5},
    })  # fmt: skip
    changed = scene.replace({f"body.{listed}": value})
    as_an_fmu_has_it = motion_of(changed, rbfmu.plan(scene), [0.5, 0.5], ["omega_b"])["omega_b"]
    truth = rbfmu.simulate(changed.replace({"inputs": None})).omega_b
    np.testing.assert_allclose(as_an_fmu_has_it, truth, rtol=0, atol=1e-6)
