"""Scenes that must be refused, each with a fragment of the one message that says why: generated from a good scene."""

from collections.abc import Iterator
from typing import NamedTuple


class BadScene(NamedTuple):
    """A file's content, a name for it, and what its message must contain."""

    name: str
    content: bytes
    fragment: str


GOOD = {
    "body": {"mass": "2.0", "inertia": "[1.0, 2.0, 2.5]", "r_oc_b": "[0.1, 0, 0]", "pivot": "false"},
    "initial": {"position": "[1, 2, 3]", "velocity": "[1, 0, 0]", "attitude": "{ quaternion = [1, 0, 0, 0] }"},
    "loads": {"gravity_a": "[0, 0, -9.81]", "torque_b": "[0, 0.1, 0]", "damping_b": "[0.1, 0.1, 0.1]"},
    "inputs": {"ports": '["torque_b"]', "parameters": '["omega_b_0"]'},
    "outputs": {"quantities": '["quaternion", "omega_b"]'},
    "run": {"start": "0.0", "stop": "1.0", "step": "0.1", "accuracy": "1e-6"},
    "about": {"description": '"a body"', "author": '"somebody"'},
}
"""Section, key, value as TOML spells it."""

VECTORS = {
    "body": ["r_oc_b"],
    "initial": ["position", "velocity", "omega_b", "omega_b_deg"],
    "loads": ["gravity_a", "force_a", "force_b", "torque_a", "torque_b", "damping_b"],
}
SCALARS = {"body": ["mass"], "run": ["start", "stop", "step", "accuracy"]}
NOT_VECTORS = {
    "text": '"1, 2, 3"', "bool": "true", "number": "1.0", "two": "[1, 2]", "four": "[1, 2, 3, 4]", "empty": "[]",
    "nested": "[[1, 2, 3]]", "table": "{ x = 1, y = 2, z = 3 }", "date": "1979-05-27", "text inside": '[1, 2, "3"]',
    "bool inside": "[1, 2, true]", "nan inside": "[1, nan, 3]", "inf inside": "[1, 2, inf]",
    "too large": "[1, 2, 1e999]", "long integer": "[1, 2, 0x1" + 5000 * "0" + "]",
}  # fmt: skip
NOT_SCALARS = {
    "text": '"1.0"', "bool": "true", "vector": "[1.0]", "table": "{}", "time": "12:00:00", "nan": "nan", "inf": "inf",
    "-inf": "-inf", "too large": "1e999", "long integer": "1" + 400 * "0",
}  # fmt: skip
NOT_INERTIA = {
    "text": ('"1, 2, 2"', "3 principal moments or a 3x3 matrix"),
    "two": ("[1, 2]", "3 principal moments or a 3x3 matrix"),
    "bool inside": ("[1, 1, true]", "3 principal moments or a 3x3 matrix"),
    "2x3": ("[[1, 0, 0], [0, 1, 0]]", "3 principal moments or a 3x3 matrix"),
    "ragged": ("[[1, 0, 0], [0, 1], [0, 0, 1]]", "3 principal moments or a 3x3 matrix"),
    "half rows": ("[[1, 0, 0], 1, 1]", "3 principal moments or a 3x3 matrix"),
    "nan": ("[1, nan, 1]", "finite"),
    "inf": ("[inf, inf, inf]", "finite"),
    "nan in a matrix": ("[[1, 0, 0], [0, 1, 0], [0, nan, 1]]", "finite"),
    "negative": ("[-1, 1, 1]", "principal moments >= 0 (kg m2), not -1"),
    "all negative": ("[-1, -1, -1]", "principal moments >= 0"),
    "indefinite": ("[[1, 2, 0], [2, 1, 0], [0, 0, 1]]", "principal moments >= 0"),
    "asymmetric": ("[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]", "symmetric"),
    "triangle": ("[1, 2, 3.0001]", "at most the sum of the other two"),
    "triangle in a matrix": ("[[2, 0.9, 0], [0.9, 2, 0], [0, 0, 5]]",
        "at most the sum of the other two (kg m2), not 1.1"),
    "point mass": ("[0, 0, 0]", "inertia = [0.0, 0.0, 0.0]: expected at most one zero moment"),
    "two zero moments": ("[0, 0, 1]", "at most the sum"),
}  # fmt: skip
NOT_SHAPES = {
    "text": ('"box"', "body.shape"),
    "no kind": ("{ sides = [1, 2, 3] }", "kind"),
    "unknown kind": ('{ kind = "cube", side = 1 }', "body.shape.kind"),
    "kind not text": ("{ kind = 3 }", "body.shape.kind"),
    "box without sides": ('{ kind = "box" }', "body.shape.sides is missing"),
    "box with two sides": ('{ kind = "box", sides = [1, 2] }', "body.shape.sides"),
    "box with a side of zero": ('{ kind = "box", sides = [1, 0, 2] }', "body.shape.sides"),
    "beam without length": ('{ kind = "beam" }', "body.shape.length is missing"),
    "beam of negative length": ('{ kind = "beam", length = -1 }', "body.shape.length"),
    "beam with a radius": ('{ kind = "beam", length = 1, radius = 0.1 }',
        "body.shape.radius = 0.1: unknown key; expected one of length, kind"),
    "cylinder without radius": ('{ kind = "cylinder", length = 1 }', "body.shape.radius is missing"),
    "cylinder of length nan": ('{ kind = "cylinder", radius = 1, length = nan }', "body.shape.length"),
    "sphere of radius zero": ('{ kind = "sphere", radius = 0 }', "body.shape.radius"),
    "sphere of text": ('{ kind = "sphere", radius = "1" }', "body.shape.radius"),
    "sphere too large": ('{ kind = "sphere", radius = 1e200 }', "body.shape"),
    "sphere too small": ('{ kind = "sphere", radius = 1e-200 }', "body.shape"),
    "ellipsoid of bools": ('{ kind = "ellipsoid", semiaxes = [true, true, true] }', "body.shape.semiaxes"),
}  # fmt: skip
NOT_ATTITUDES = {
    "text": ('"ZYX"', "initial.attitude"),
    "list": ("[1, 0, 0, 0]", "initial.attitude"),
    "nothing": ("{}", "exactly one of"),
    "two ways": ("{ quaternion = [1, 0, 0, 0], rotvec = [0, 0, 0] }", "exactly one of"),
    "unknown way": ("{ quaternoin = [1, 0, 0, 0] }", "did you mean quaternion?"),
    "euler alone": ('{ euler = "ZYX" }', "angles_deg or angles"),
    "angles alone": ("{ angles = [1, 2, 3] }", "exactly one of"),
    "angles twice": ('{ euler = "ZYX", angles = [1, 2, 3], angles_deg = [1, 2, 3] }', "angles_deg or angles"),
    "angles of a quaternion": ("{ quaternion = [1, 0, 0, 0], angles = [1, 2, 3] }", "angles belong to euler"),
    "unknown sequence": ('{ euler = "ZYY", angles = [1, 2, 3] }', "initial.attitude.euler"),
    "mixed sequence": ('{ euler = "ZyX", angles = [1, 2, 3] }', "initial.attitude.euler"),
    "sequence not text": ("{ euler = 321, angles = [1, 2, 3] }", "initial.attitude.euler"),
    "two angles": ('{ euler = "ZYX", angles = [1, 2] }', "initial.attitude.angles"),
    "angle nan": ('{ euler = "ZYX", angles_deg = [1, 2, nan] }', "initial.attitude.angles_deg"),
    "zero quaternion": ("{ quaternion = [0, 0, 0, 0] }", "not zero"),
    "long quaternion": ("{ quaternion = [1, 0, 0, 2e-3] }", "length 1.000002"),
    "short quaternion": ("{ quaternion = [0.9, 0, 0, 0] }", "length 0.9"),
    "quaternion of three": ("{ quaternion = [1, 0, 0] }", "initial.attitude.quaternion"),
    "quaternion nan": ("{ quaternion = [nan, 0, 0, 0] }", "initial.attitude.quaternion"),
    "quaternion too large": ("{ quaternion = [1e308, 1e308, 1e308, 1e308] }", "length inf"),
    "rotvec of four": ("{ rotvec = [1, 2, 3, 4] }", "initial.attitude.rotvec"),
    "rotvec too large": ("{ rotvec = [1e200, 0, 0] }", "from -1e9 to 1e9 (rad)"),
    "angle too large": ('{ euler = "ZYX", angles_deg = [0, -1e10, 0] }', "from -1e9 to 1e9 (deg)"),
    "rotvec inf": ("{ rotvec = [1, 2, -inf] }", "initial.attitude.rotvec"),
    "reflection": ("{ matrix = [[1, 0, 0], [0, 1, 0], [0, 0, -1]] }", "reflection"),
    "stretched matrix": ("{ matrix = [[1.001, 0, 0], [0, 1, 0], [0, 0, 1]] }", "initial.attitude.matrix"),
    "zero matrix": ("{ matrix = [[0, 0, 0], [0, 0, 0], [0, 0, 0]] }", "initial.attitude.matrix"),
    "huge matrix": ("{ matrix = [[1e300, 0, 0], [0, 1e300, 0], [0, 0, 1e300]] }", "initial.attitude.matrix"),
    "matrix of two rows": ("{ matrix = [[1, 0, 0], [0, 1, 0]] }", "initial.attitude.matrix"),
}
NOT_NAMES = {
    "text": ('"torque_b"', ""), "numbers": ("[1, 2]", ""), "number": ("3", ""),
    "unknown": ('["nonsense"]', '"nonsense"'), "twice": ('["quaternion", "quaternion"]', ""),
    "capital": ('["Torque_B"]', '"Torque_B"'),
}  # fmt: skip
BEAM = {"mass": "1.0", "shape": '{ kind = "beam", length = 2.0 }'}
TURNED_BEAM = {"mass": "1.0", "inertia": "[[0.5, -0.5, 0], [-0.5, 0.5, 0], [0, 0, 1]]"}
BEAMS = {
    "rate about its axis": (BEAM, "initial", "omega_b", "[0.1, 2, 3]", "initial.omega_b"),
    "rate about its axis in degrees": (BEAM, "initial", "omega_b_deg", "[5, 2, 3]", "initial.omega_b_deg = [5, 2, 3]"),
    "torque_b about its axis": (BEAM, "loads", "torque_b", "[0.1, 0, 0]", "loads.torque_b"),
    "torque_a": (BEAM, "loads", "torque_a", "[0, 0, 0.1]", "loads.torque_a"),
    "torque_b port": (BEAM, "inputs", "ports", '["torque_b"]', "no torque_b"),
    "torque_a port": (BEAM, "inputs", "ports", '["torque_a"]', "no torque_a"),
    "force_b off its axis": (BEAM | {"r_oc_b": "[1, 0.1, 0]"}, "loads", "force_b", "[0, 0, 1]", "loads.force_b"),
    "force_a off its axis": (BEAM | {"r_oc_b": "[1, 0.1, 0]"}, "loads", "force_a", "[0, 0, 1]", "loads.force_a"),
    "force port off its axis": (BEAM | {"r_oc_b": "[1, 0.1, 0]"}, "inputs", "ports", '["force_a"]', "no force_a"),
    "turned: rate": (TURNED_BEAM, "initial", "omega_b", "[1, 1, 0]", "initial.omega_b"),
    "turned: damping": (TURNED_BEAM, "loads", "damping_b", "[1, 2, 0]", "loads.damping_b"),
    "turned: little damping": (TURNED_BEAM, "loads", "damping_b", "[1e-13, 2e-13, 0]", "loads.damping_b"),
    "pivot on its axis": (
        *(BEAM | {"r_oc_b": "[1, 0, 0]", "pivot": "true"}, "inputs", "ports", '["torque_b"]', "no torque_b"),
    ),
}
CONTRADICTIONS = {
    "stop before start": ({"run": {"start": "2.0"}}, "run.stop = 1.0: expected a time after run.start = 2.0"),
    "stop at start": ({"run": {"stop": "0"}}, "run.stop"),
    "span too large": ({"run": {"start": "-1e308", "stop": "1e308"}}, "run.stop"),
    "step too long": ({"run": {"step": "1.1"}}, "run.step"),
    "step lost in the clock": ({"run": {"start": "1e9", "stop": "2e9", "step": "1e-9"}}, "run.step"),
    "velocity of a pivot": ({"body": {"pivot": "true"}}, "initial.velocity"),
    "parameter of a pivot": ({"body": {"pivot": "true"}, "inputs": {"parameters": '["velocity_0"]'}}, "no velocity_0"),
    "port and parameter": ({"inputs": {"parameters": '["torque_b"]'}}, "inputs.parameters"),
    "rates and torque": ({"inputs": {"ports": '["omega_b", "torque_b"]'}}, "omega_b alone"),
    "rates and omega_b": ({"inputs": {"ports": '["omega_b"]', "parameters": "[]"}}, "outputs.quantities"),
    "rates and a body": ({"inputs": {"ports": '["omega_b"]', "parameters": "[]"}}, "a table [body] is given"),
    "a list among quantities": ({"outputs": {"quantities": "[[]]"}}, "outputs.quantities"),
    "rates and mass": ({"inputs": {"ports": '["omega_b"]', "parameters": '["mass"]'}}, "inputs.parameters"),
    "rates and a rate": ({"inputs": {"ports": '["omega_b"]'}, "initial": {"omega_b": "[1, 2, 3]"}}, "initial.omega_b"),
    "rates and a rate in degrees": ({"inputs": {"ports": '["omega_b"]'}, "initial": {"omega_b_deg": "[1, 2, 3]"}},
        "initial.omega_b_deg = [1, 2, 3]: expected zero, or no such key: the port omega_b prescribes the rates"),
    "rates and a load": ({"inputs": {"ports": '["omega_b"]'}, "loads": {"torque_b": "[0, 0, 1]"}},
        "loads.torque_b = [0.0, 0.0, 1.0]: expected zero, or no such key: the port omega_b prescribes the rates"),
    "rates and an output of one's own": ({"inputs": {"ports": '["omega_b"]'}, "outputs": {"tilt": '"acos(R_ab[3,3])"'}},
        "outputs.tilt: expected no formulas"),
    "inertia and shape": ({"body": {"shape": '{ kind = "sphere", radius = 1 }'}}, "inertia or shape, not both"),
    "omega_b twice": ({"initial": {"omega_b": "[0, 0, 0]", "omega_b_deg": "[0, 0, 0]"}}, "not both"),
    "rates too large": ({"initial": {"omega_b": "[1e308, 0, 0]"}}, "squares have a finite sum (rad/s)"),
    "rates too large in degrees": ({"initial": {"omega_b_deg": "[0, 1e160, 0]"}}, "squares have a finite sum (deg/s)"),
    "no mass": ({"body": {"mass": ""}}, "body.mass is missing"),
    "no inertia": ({"body": {"inertia": ""}}, "body.inertia is missing"),
    "shape without mass": ({"body": {"mass": "", "inertia": "", "shape": '{ kind = "beam", length = 1 }'}},
        "body.mass"),
    "far pivot": ({"body": {"pivot": "true", "r_oc_b": "[1e200, 0, 0]"}}, "body.r_oc_b"),
    "an output that is a number": ({"outputs": {"tilt": "3.0"}},
        "outputs.tilt = 3.0: unknown key; expected one of quantities, NAME = a formula"),
    "no quantities": ({"outputs": {"quantities": "[]"}}, "outputs.quantities"),
    "accuracy above one": ({"run": {"accuracy": "1.5"}}, "run.accuracy"),
}  # fmt: skip
FILES = {
    "empty file": (b"", "[body]"),
    "only a comment": (b"# nothing\n", "[body]"),
    "no body": (b"[run]\nstop = 1.0\n", "[body]"),
    "binary file": (bytes(range(256)), "UTF-8"),
    "zeros": (bytes(100), "not TOML"),
    "UTF-16": ("[body]\nmass = 1\n".encode("utf-16"), "UTF-8"),
    "JSON": (b'{"body": {"mass": 1.0}}', "not TOML"),
    "unclosed": (b"[body]\nmass = [1.0\n", "not TOML"),
    "key twice": (b"[body]\nmass = 1.0\nmass = 2.0\n", "body.mass stands twice, again in line 3"),
    "key twice in many lines": (
        b"[body]\nmass = 1\ninertia = [1,\n2, 2]\n# again\ninertia = [1, # x\n2, 2]\n[run]\nstop = 1\n",
        "body.inertia stands twice, again in line 6",
    ),
    "key twice at the end": (b'[body]\n"a b" = 1\n"a b" = 2', 'body."a b" stands twice, again in line 3'),
    "name twice": (b"name = 'a'\nname = 'b'\n", "name stands twice, again in line 2"),
    "table twice": (b"[body]\nmass = 1\n[run]\nstop = 1\n\n[body]\npivot = true\n",
        "body stands twice, again in line 6"),
    "dotted key twice": (b"[initial]\nattitude.euler = 'ZYX'\nattitude.euler = 'xyz'\n",
        "initial.attitude.euler stands twice, again in line 3"),
    "key twice in a row": (b"[body]\nshape = { kind = 'box', kind = 'box' }\n", "'kind'"),
    "yes": (b"[body]\npivot = yes  # it is\n", "expected true or false in place of yes"),
    "True": (b"[body]\r\npivot = True\r\n", "expected true or false in place of True"),
    "no value": (b"[body]\nmass =\n", "not TOML"),
    "nested without end": (b"x = " + 100_000 * b"[", "nested"),
    "very large": (b"#" * 1_000_001, "larger than"),
    "body is a number": (b"body = 3\n", "body = 3: expected a table"),
    "two bodies": (b"[[body]]\nmass = 1\n[[body]]\nmass = 2\n", "expected a table"),
    "keys without section": (b"mass = 1.0\ninertia = [1, 1, 1]\n", "did you mean body.mass?"),
    "section of a typo": (b"[bdoy]\nmass = 1.0\n", "did you mean body?"),
}  # fmt: skip


def text(changes: dict[str, dict[str, str]], good: dict[str, dict[str, str]] = GOOD, head: str = "") -> str:
    """A good scene with changes; an empty value leaves the key out."""
    lines = [head]
    for section in good | changes:
        values = good.get(section, {}) | changes.get(section, {})
        lines += [f"[{section}]", *(f"{key} = {value}" for key, value in values.items() if value)]
    return "\n".join(lines) + "\n"


def _cases() -> Iterator[tuple[str, str, str]]:
    for section, keys in VECTORS.items():
        for key in keys:
            for name, value in NOT_VECTORS.items():
                yield f"{key} {name}", text({section: {key: value}}), f"{section}.{key}"
    yield "damping negative", text({"loads": {"damping_b": "[0.1, -0.1, 0]"}}), "loads.damping_b"
    for section, keys in SCALARS.items():
        for key in keys:
            for name, value in NOT_SCALARS.items():
                yield f"{key} {name}", text({section: {key: value}}), f"{section}.{key}"
    for section, key in (("body", "mass"), ("run", "step"), ("run", "accuracy")):
        for value in ("0", "0.0", "-0.0", "-1", "-1e-9"):
            yield f"{key} {value}", text({section: {key: value}}), f"{section}.{key} = "
    for value in ('"yes"', "1", "0.0", "[true]"):
        yield f"pivot {value}", text({"body": {"pivot": value}}), "body.pivot"
    for value in ('""', '"  "', "3", "true", '"a/b"', '"a\\nb"', '"' + 201 * "x" + '"'):
        yield f"name {value[:9]}", text({}, head=f"name = {value}"), "name = "
    for name, (value, fragment) in NOT_INERTIA.items():
        yield f"inertia {name}", text({"body": {"inertia": value}}), fragment
    for name, (value, fragment) in NOT_SHAPES.items():
        yield f"shape {name}", text({"body": {"inertia": "", "shape": value}}), fragment
    for name, (value, fragment) in NOT_ATTITUDES.items():
        yield f"attitude {name}", text({"initial": {"attitude": value}}), fragment
    for section, key in (("inputs", "ports"), ("inputs", "parameters"), ("outputs", "quantities")):
        for name, (value, fragment) in NOT_NAMES.items():
            yield f"{key} {name}", text({section: {key: value}}), fragment or f"{section}.{key}"
    for section in GOOD:
        yield f"unknown key in {section}", text({section: {"nonsense": "1"}}), f"{section}.nonsense = 1: unknown key"
        yield (
            f"{section} a number",
            text({}, {k: v for k, v in GOOD.items() if k != section}, f"{section} = 1"),
            section,
        )
    yield "unknown section", text({"nonsense": {"x": "1"}}), "nonsense"
    yield "unknown key above", text({}, head="nonsense = 1"), "nonsense = 1: unknown key"
    for name, (body, section, key, value, fragment) in BEAMS.items():
        yield f"beam {name}", text({section: {key: value}}, {"body": body}), fragment
    for name, (changes, fragment) in CONTRADICTIONS.items():
        yield name, text(changes), fragment


BAD_SCENES = [BadScene(name, content.encode(), fragment) for name, content, fragment in _cases()]
BAD_SCENES += [BadScene(name, content, fragment) for name, (content, fragment) in FILES.items()]
