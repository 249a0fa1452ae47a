"""The keys of a scene that vary in an ensemble: the distributions of their numbers, read from `[ensemble.vary]`."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rbfmu.scene import body, own, section as rules, tables
from rbfmu.scene.section import SceneError, as_toml, checked, closest, fault, flattened, joined, plain, read_each
from rbfmu_kernels.quantities import IN_BUFFER_ORDER, INITIAL_VALUES, LOADS, PARAMETERS, Load, Parameter, indices

_BY_NAME = {row.name: row for row in IN_BUFFER_ORDER}
FIXED, NORMAL, UNIFORM = "fixed", "normal", "uniform"
LOGNORMAL, TRIANGULAR, RELATIVE = "lognormal", "triangular", "relative"


class Distribution(NamedTuple):
    """A kind of distribution: its arguments in words, and functions that make the rule of each from the key's rule.

    ascending: whether the arguments must be in ascending order, and bound the values.
    """

    expected: str
    arguments: tuple[Callable[[rules.Numbers], rules.Numbers], ...]
    ascending: bool = False


class Alike(rules.Numbers):
    """The rule of a vector, for which one number means that all components are equal."""

    def _convert(self, value: object) -> object:
        value = plain(value)
        if self.shape and not isinstance(value, list | tuple):
            value = np.full(self.shape, rules.Numbers((), self.unit, self.bound, self.holds)(value))
        return super()._convert(value)


def _location(rule: rules.Numbers) -> rules.Numbers:
    return rule


def _median(rule: rules.Numbers) -> rules.Numbers:
    return rules.Numbers(rule.shape, rule.unit, *rules.POSITIVE)


def _spread(rule: rules.Numbers) -> rules.Numbers:
    return Alike(rule.shape, rule.unit, *rules.NOT_NEGATIVE)


def _share(rule: rules.Numbers) -> rules.Numbers:
    return Alike(rule.shape, "", *rules.NOT_NEGATIVE)


DISTRIBUTIONS: Mapping[str, Distribution] = {
    NORMAL: Distribution("[mean, standard deviation]", (_location, _spread)),
    UNIFORM: Distribution("[low, high]", (_location,) * 2, ascending=True),
    LOGNORMAL: Distribution("[median, standard deviation of the logarithm]", (_median, _share)),
    TRIANGULAR: Distribution("[low, most likely, high]", (_location,) * 3, ascending=True),
    RELATIVE: Distribution("the standard deviation over the scene's value", (_share,)),
}
"""The distributions of a key that varies. `ensembles/draws` maps points of the unit cube to values by these kinds."""


class Marginal(NamedTuple):
    """The distribution of one number; arguments: as in `DISTRIBUTIONS`; points: their number in a grid."""

    name: str
    kind: str
    arguments: tuple[float, ...]
    points: int = 0

    @property
    def varies(self) -> bool:
        """Return whether the number varies."""
        if self.kind == FIXED:
            return False
        low = self.arguments[0] if DISTRIBUTIONS[self.kind].ascending else 0.0
        return low < self.arguments[-1]

    @property
    def constant(self) -> float:
        """Return the value if the number does not vary: 1 if it is relative."""
        return 1.0 if self.kind == RELATIVE else self.arguments[0]


def component_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of a key's numbers; a matrix has the six of one triangle."""
    if len(shape) == 2:
        return [f"{name}{index}" for index in indices(_BY_NAME["inertia"])]
    return [f"{name}[{k}]" for k in range(1, shape[0] + 1)] if shape else [name]


def components(value: Any, shape: tuple[int, ...]) -> list[float]:
    """Return a key's numbers one after another. Raises ValueError if a matrix is not symmetric."""
    if len(shape) < 2:
        return list(flattened(value))
    largest = max(map(abs, flattened(value)))
    if any(abs(value[i][j] - value[j][i]) > 1e-12 * largest for i, j in body.TRIANGLE):
        raise ValueError("a symmetric matrix")
    return body.six_numbers(value)


INERTIA, ATTITUDE, SHAPE, DEGREES = "body.inertia", "initial.attitude", "body.shape", "initial.omega_b_deg"
AXES = "axes_deg"
ABOUT = {"rotvec_deg": "deg", "rotvec": "rad"}
"""The keys for standard deviations of a rotation vector, with their units."""
ATTITUDES = ({"rotvec_deg"}, {"rotvec"}, {"euler", "angles_deg"}, {"euler", "angles"})
"""The sets of keys that can describe how an attitude varies."""
VARYING_ANGLES = ("angles_deg", "angles", "rotvec")
"""The representations of an attitude whose numbers may vary one by one."""


@dataclass(frozen=True)
class Variation:
    """A key that varies. marginals: of all its numbers; form: how the key gives them; text: its value, as JSON."""

    key: str
    form: str
    marginals: tuple[Marginal, ...]
    text: str

    @property
    def is_relative(self) -> bool:
        """Return whether its numbers are factors on the scene's numbers."""
        return self.form == RELATIVE

    @property
    def table(self) -> Any:
        """Return the key's value, as in the file."""
        return json.loads(self.text)

    def refused(self, expected: str, part: str = "") -> str:
        """Return the fault of the key's value, or of a part of it."""
        path = joined("ensemble.vary", self.key)
        return fault(f"{path}.{part}", self.table[part], expected) if part else fault(path, self.table, expected)


QUANTITY_OF: Mapping[str, Parameter | Load] = (
    {f"body.{row.name}": row for row in PARAMETERS}
    | {f"initial.{row.name.removesuffix('_0')}": row for row in INITIAL_VALUES if row.name != "quaternion_0"}
    | {DEGREES: _BY_NAME["omega_b_0"]}
    | {f"loads.{load.name}": load for load in LOADS}
    | {ATTITUDE: _BY_NAME["quaternion_0"], SHAPE: _BY_NAME["inertia"]}
)
"""The quantity that is set by each key that may vary."""
RULES: Mapping[str, rules.Numbers] = {
    key: rules.Numbers((3,), "deg/s") if key == DEGREES else rules.numbers(row.name)
    for key, row in QUANTITY_OF.items()
    if key not in (INERTIA, ATTITUDE, SHAPE)
}
"""The rule of each key whose numbers vary directly, unlike those of an inertia, an attitude or a shape."""
KEYS = (*RULES, INERTIA, ATTITUDE, SHAPE)


def read_variations(vary: object) -> tuple[Variation, ...] | None:
    """Return the keys that vary, from the table `ensemble.vary`; None if it is no table or empty. Raises SceneError."""
    if not isinstance(vary, Mapping) or not vary:
        return None
    return tuple(read_each(vary, "ensemble.vary", _read_variation).values())


def _read_variation(key: str, value: object, path: str) -> Variation:
    marginals, form = _READERS.get(key, partial(_read_numbers, key))(value, path)
    if not any(m.varies for m in marginals) and key != SHAPE:
        raise SceneError(fault(path, value, "a distribution in which something varies"))
    text = json.dumps(value, default=lambda x: dict(x) if isinstance(x, Mapping) else plain(x))
    return Variation(key, form, marginals, text)


Marginals = tuple[Marginal, ...]
Reading = tuple[Marginals, str]
"""The marginals of a key, and the form in which they are given."""


def _marginals_of(name: str, rule: rules.Numbers, value: object, path: str, relative: bool = True) -> Marginals:
    """Return the marginals of a varying number or vector; rule: of its values. Raises SceneError."""
    kinds = {kind: row for kind, row in DISTRIBUTIONS.items() if relative or kind != RELATIVE}
    given = [key for key in value if key in kinds] if isinstance(value, Mapping) else []
    if not isinstance(value, Mapping) or len(given) != 1 or set(value) - {*given, "points"}:
        ways = ", ".join(f"{kind} = {row.expected}" for kind, row in kinds.items())
        raise SceneError(fault(path, value, f"a table with one of {ways}"))
    kind, each, faults = given[0], component_names(name, rule.shape), list[str]()
    rows = checked(_arguments(kind, rule).read, value[kind], f"{path}.{kind}", faults)
    points = checked(_points(len(each)).read, value.get("points", 0), f"{path}.points", faults)
    if faults:
        raise SceneError(faults)
    return tuple(Marginal(n, kind, x, p) for n, x, p in zip(each, zip(*rows, strict=True), points, strict=True))


def _arguments(kind: str, rule: rules.Numbers) -> rules.Rule:
    """Return the rule that reads a distribution's arguments: for each a list of numbers, one for each component."""
    expected, makers, ascending = DISTRIBUTIONS[kind]
    readers = [make(rule) for make in makers]

    def convert(value: object) -> list[list[float]] | None:
        values = [value] if kind == RELATIVE else value
        if not isinstance(values, list | tuple) or len(values) != len(readers):
            return None
        try:
            rows = [components(reader(x), rule.shape) for reader, x in zip(readers, values, strict=True)]
        except ValueError as error:
            raise ValueError(f"{expected}: {error}") from None
        if ascending and any(list(column) != sorted(column) for column in zip(*rows, strict=True)):
            raise ValueError(f"{expected} in ascending order")
        return rows

    return rules.Rule(f"{expected}, each {readers[0].words}", convert)


MOST_POINTS = 1_000_000
"""The most points of one number in a grid."""


def _points(count: int) -> rules.Rule:
    """Return the rule of the numbers of points of a key with `count` components."""

    def convert(value: object) -> list[object] | None:
        each = list(value) if isinstance(value, list | tuple) else [value] * count
        found = [n for n in map(rules.whole(0, MOST_POINTS).convert, each) if n is not None]
        return found if len(found) == len(each) == count else None

    several = f", or {count} of them" if count > 1 else ""
    return rules.Rule(f"a number of points of the grid, at most {MOST_POINTS}{several}", convert)


def _about_zero(name: str, unit: str) -> rules.Numbers:
    """Return the rule that reads a rotation vector's standard deviations as marginals."""
    names = component_names(name, (3,))
    bound = " >= 0: standard deviations, or one for all", rules.NOT_NEGATIVE[1]
    return Alike(
        (3,), unit, *bound, lambda s: tuple(Marginal(n, NORMAL, (0.0, x)) for n, x in zip(names, s, strict=True))
    )


_REFUSED = {
    f"{SHAPE}.": f'no such key without body.shape; or "{SHAPE}" = {{ kind = ..., sides = {{ normal = ... }} }}',
    f"{ATTITUDE}.": f'"{ATTITUDE}" = {{ rotvec_deg = 2.0 }}, {{ euler = "ZYX", angles_deg = {{ normal = ... }} }}',
    "run.": "a key of body, initial or loads, a constant or a state: all runs have the same times and accuracy",
}
"""What a message expects in place of keys that begin in these ways."""


def _read_numbers(key: str, value: object, path: str) -> Reading:
    """Return the marginals of numbers that vary directly: of a body, a start or a load, or the scene's own."""
    if key in RULES:
        rule = RULES[key]
    elif own.is_own(key):
        given = value.items() if isinstance(value, Mapping) else ()
        rule = rules.Numbers((3,) if any(_is_nested(x, 1 if kind == RELATIVE else 2) for kind, x in given) else ())
    elif expected := next((said for begin, said in _REFUSED.items() if key.startswith(begin)), ""):
        raise SceneError(fault(path, value, expected))
    else:
        near = closest(key, KEYS)
        expected = f"did you mean {near}?" if near else f"keys out of {', '.join(KEYS)}, constants.NAME, states.NAME"
        raise SceneError(f"{path} = {as_toml(value)}: unknown key; {expected}")
    marginals = _marginals_of(key, rule, value, path)
    return marginals, marginals[0].kind


def _read_inertia(value: object, path: str) -> Reading:
    moments, faults = value, list[str]()
    found, axes = (), ()
    if isinstance(value, Mapping) and AXES in value:
        moments = {key: item for key, item in value.items() if key != AXES}
        axes = checked(_about_zero(f"{INERTIA}.{AXES}", "deg").read, value[AXES], f"{path}.{AXES}", faults)
    if moments or moments is value:
        matrix = isinstance(moments, Mapping) and any(_is_nested(moments.get(kind), 3) for kind in DISTRIBUTIONS)
        if matrix and axes:
            faults.append(fault(path, value, f"principal moments, or no {AXES}: a matrix has its axes"))
        rule = rules.Numbers((3, 3) if matrix else (3,), "kg m2")
        found = checked(partial(_marginals_of, INERTIA, rule), moments, path, faults)
    if faults:
        raise SceneError(faults)
    return (*found, *axes), found[0].kind if found else ""


def _read_attitude(value: object, path: str) -> Reading:
    if value == UNIFORM:
        names = component_names(f"{ATTITUDE}.{UNIFORM}", (3,))
        return tuple(Marginal(name, UNIFORM, (0.0, 1.0)) for name in names), UNIFORM
    if not isinstance(value, Mapping) or set(value) not in ATTITUDES:
        ways = '"uniform", { rotvec_deg = 2.0 } about the scene\'s, or { euler = "ZYX", angles_deg = { normal = ... } }'
        raise SceneError(fault(path, value, f"{ways}, or {{ rotvec = {{ normal = ... }} }}"))
    name = next(key for key in value if key != "euler")
    angles, here = value[name], f"{path}.{name}"
    if name in ABOUT and not isinstance(angles, Mapping):
        return _about_zero(f"{ATTITUDE}.{name}", ABOUT[name]).read(angles, here), f"about {name}"
    if "euler" in value:
        tables.Attitude._rules["euler"].read(value["euler"], f"{path}.euler")
    rule = tables.Attitude._rules[name if name in VARYING_ANGLES else "rotvec"]
    return _marginals_of(f"{ATTITUDE}.{name}", rule, angles, here, relative=False), name


def _read_shape(value: object, path: str) -> Reading:
    if not isinstance(value, Mapping) or not isinstance(kind := value.get("kind"), str) or kind not in body.SHAPES:
        raise SceneError(fault(path, value, f"a table with kind out of {', '.join(body.SHAPES)}, and its sizes"))
    shape, keys = body.SHAPES[kind], body.SHAPES[kind].sizes()
    if set(value) != {"kind", *keys}:
        raise SceneError(fault(path, value, f"a {kind} with {' and '.join(keys)}"))

    def size(key: str, value: object, path: str) -> Marginals:
        name, rule = f"{SHAPE}.{key}", shape._rules[key]
        if isinstance(value, Mapping):
            return _marginals_of(name, rule, value, path, relative=False)
        row = components(rule.read(value, path), rule.shape)
        return tuple(Marginal(n, FIXED, (x,)) for n, x in zip(component_names(name, rule.shape), row, strict=True))

    found = read_each({key: value[key] for key in keys}, path, size)
    return tuple(marginal for marginals in found.values() for marginal in marginals), kind


_READERS: Mapping[str, Callable[..., Reading]] = {INERTIA: _read_inertia, ATTITUDE: _read_attitude, SHAPE: _read_shape}
"""The readers of keys whose tables have special forms."""


def _is_nested(value: object, levels: int) -> bool:
    """Return whether lists are nested, at least `levels` deep."""
    return isinstance(value, list | tuple) and (levels == 1 or any(_is_nested(item, levels - 1) for item in value))
