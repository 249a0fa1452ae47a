"""The keys of a scene that vary in an ensemble: the distributions of their numbers, read from `[ensemble.vary]`."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rbfmu.scene.attitude import Attitude
from rbfmu.scene.body import SHAPES, TRIANGLE, six_numbers
from rbfmu.scene.own import is_own

from rbfmu.scene.section import (  # isort: skip
    NOT_NEGATIVE, POSITIVE, Numbers, Rule, SceneError, as_toml, closest, fault, flattened, joined, numbers, plain,
)  # fmt: skip
from rbfmu_kernels.quantities import IN_BUFFER_ORDER, INITIAL_VALUES, LOADS, PARAMETERS, Load, Parameter, indices

_BY_NAME = {row.name: row for row in IN_BUFFER_ORDER}
FIXED, NORMAL, UNIFORM, LOGNORMAL, TRIANGULAR, RELATIVE = (
    "fixed", "normal", "uniform", "lognormal", "triangular", "relative",
)  # fmt: skip


class Distribution(NamedTuple):
    """A kind of distribution: its arguments in words, and the rule of each, made of the rule of the key's numbers.

    ascending: they are ordered, and bound the values.
    """

    expected: str
    rules: tuple[Callable[[Numbers], Numbers], ...]
    ascending: bool = False


def _location(rule: Numbers) -> Numbers:
    return rule


def _median(rule: Numbers) -> Numbers:
    return Numbers(rule.shape, rule.unit, *POSITIVE)


def _spread(rule: Numbers) -> Numbers:
    return Numbers(rule.shape, rule.unit, *NOT_NEGATIVE)


def _share(rule: Numbers) -> Numbers:
    return Numbers(rule.shape, "", *NOT_NEGATIVE)


DISTRIBUTIONS: Mapping[str, Distribution] = {
    NORMAL: Distribution("[mean, standard deviation]", (_location, _spread)),
    UNIFORM: Distribution("[low, high]", (_location,) * 2, ascending=True),
    LOGNORMAL: Distribution("[median, standard deviation of the logarithm]", (_median, _share)),
    TRIANGULAR: Distribution("[low, most likely, high]", (_location,) * 3, ascending=True),
    RELATIVE: Distribution("the standard deviation over the scene's value", (_share,)),
}
"""What stands under a key that varies. `ensembles/draws` makes values of points of the unit cube by the same kinds."""


class Marginal(NamedTuple):
    """The distribution of one number; arguments as in `DISTRIBUTIONS`; points: in a grid."""

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
        """Return the value where nothing varies: what is relative is then 1."""
        return 1.0 if self.kind == RELATIVE else self.arguments[0]


def component_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of a key's numbers: of a matrix the six of one triangle."""
    if len(shape) == 2:
        return [f"{name}{index}" for index in indices(_BY_NAME["inertia"])]
    return [f"{name}[{k}]" for k in range(1, shape[0] + 1)] if shape else [name]


def components(value: Any, shape: tuple[int, ...]) -> list[float]:
    """Return a key's numbers one after another. Raises ValueError where a matrix is not symmetric."""
    if len(shape) < 2:
        return list(flattened(value))
    largest = max(map(abs, flattened(value)))
    if any(not math.isclose(value[i][j], value[j][i], abs_tol=1e-12 * largest) for i, j in TRIANGLE):
        raise ValueError("a symmetric matrix")
    return six_numbers(value)


INERTIA, ATTITUDE, SHAPE, DEGREES = "body.inertia", "initial.attitude", "body.shape", "initial.omega_b_deg"
AXES = "axes_deg"
ABOUT = {"rotvec_deg": "deg", "rotvec": "rad"}
"""Ways to give standard deviations of a rotation vector, by their unit."""
VARYING_ANGLES = ("angles_deg", "angles", "rotvec")
"""Representations of an attitude whose numbers may vary one by one."""


@dataclass(frozen=True)
class Variation:
    """A key that varies. marginals: of all its numbers; form: the key's way to give them; text: as written, in JSON."""

    key: str
    form: str
    marginals: tuple[Marginal, ...]
    text: str

    @property
    def is_relative(self) -> bool:
        """Return whether its numbers are factors of the scene's."""
        return self.form == RELATIVE

    @property
    def table(self) -> Any:
        """Return what the file says of the key."""
        return json.loads(self.text)


QUANTITY_OF: Mapping[str, Parameter | Load] = (
    {f"body.{row.name}": row for row in PARAMETERS}
    | {f"initial.{row.name.removesuffix('_0')}": row for row in INITIAL_VALUES if row.name != "quaternion_0"}
    | {DEGREES: _BY_NAME["omega_b_0"]}
    | {f"loads.{load.name}": load for load in LOADS}
    | {ATTITUDE: _BY_NAME["quaternion_0"], SHAPE: _BY_NAME["inertia"]}
)
"""The quantity that each key sets which may vary."""
RULES: Mapping[str, Numbers] = {
    key: Numbers((3,), "deg/s") if key == DEGREES else numbers(row.name)
    for key, row in QUANTITY_OF.items()
    if key not in (INERTIA, ATTITUDE, SHAPE)
}
"""The rule of each key whose numbers stand for themselves."""
KEYS = (*RULES, INERTIA, ATTITUDE, SHAPE)


def read_variations(vary: object) -> tuple[Variation, ...] | None:
    """Return the keys that vary, of the table `ensemble.vary`. Raises SceneError."""
    if not isinstance(vary, Mapping) or not vary:
        return None
    found, faults = list[Variation](), list[str]()
    for key, value in vary.items():
        reader = _Reader(str(key), value, faults)
        before = len(faults)
        marginals, form = reader.read()
        if len(faults) == before and not any(m.varies for m in marginals) and key != SHAPE:
            reader.refuse(value, "a distribution in which something varies")
        if len(faults) == before:
            found.append(Variation(str(key), form, marginals, json.dumps(value, default=_for_json)))
    if faults:
        raise SceneError(faults)
    return tuple(found)


def _for_json(value: Any) -> Any:
    """Return what JSON does not know as what it knows."""
    return dict(value) if isinstance(value, Mapping) else plain(value)


Found = tuple[tuple[Marginal, ...], str]
"""The marginals of a key, and the form in which they are given."""


class _Reader:
    """The reader of one key's distributions."""

    def __init__(self, key: str, value: Any, faults: list[str]) -> None:
        self.key, self.value, self.faults = key, value, faults
        self.path = joined("ensemble.vary", key)

    def refuse(self, value: Any, expected: str, path: str = "") -> Found:
        self.faults.append(fault(path or self.path, value, expected))
        return (), ""

    def read(self) -> Found:
        """Return the marginals and the form."""
        readers = {INERTIA: self._inertia, ATTITUDE: self._attitude, SHAPE: self._shape}
        if self.key in readers:
            return readers[self.key]()
        if is_own(self.key):
            given = self.value.items() if isinstance(self.value, Mapping) else ()
            vector = any(_nested(x, 1 if kind == RELATIVE else 2) for kind, x in given)
            return self._distribution(self.path, self.value, self.key, Numbers((3,) if vector else ()))
        if self.key not in RULES:
            return self._refuse_key()
        return self._distribution(self.path, self.value, self.key, RULES[self.key])

    def _refuse_key(self) -> Found:
        if self.key.startswith(f"{SHAPE}."):
            expected = f'no such key without body.shape; or "{SHAPE}" = {{ kind = ..., sides = {{ normal = ... }} }}'
        elif self.key.startswith(f"{ATTITUDE}."):
            expected = f'"{ATTITUDE}" = {{ rotvec_deg = 2.0 }}, {{ euler = "ZYX", angles_deg = {{ normal = ... }} }}'
        elif self.key.startswith("run."):
            expected = "a key of body, initial or loads: all runs have the same times and accuracy"
        else:
            near = closest(self.key, KEYS)
            expected = f"did you mean {near}?" if near else f"keys out of {', '.join(KEYS)}"
            self.faults.append(f"{self.path} = {as_toml(self.value)}: unknown key; {expected}")
            return (), ""
        return self.refuse(self.value, expected)

    # Numbers

    def _distribution(
        self, path: str, value: Any, name: str, rule: Numbers, beside: tuple[str, ...] = (), relative: bool = True
    ) -> Found:
        """Return the marginals of a number or a vector, and the kind. beside: other keys that the table may have."""
        kinds = [kind for kind in DISTRIBUTIONS if relative or kind != RELATIVE]
        given = [key for key in value if key in kinds] if isinstance(value, Mapping) else []
        others = set(value) - {*kinds, "points", *beside} if isinstance(value, Mapping) else set()
        if len(given) != 1 or others:
            ways = ", ".join(f"{kind} = {DISTRIBUTIONS[kind].expected}" for kind in kinds)
            return self.refuse(value, f"a table with one of {ways}", path)
        kind = given[0]
        rows = self._arguments(f"{path}.{kind}", kind, value[kind], rule)
        points = self._points(f"{path}.points", value.get("points", 0), rule.shape)
        names = component_names(name, rule.shape)
        if rows is None or points is None:
            return (), ""
        columns = zip(*rows, strict=True)
        return tuple(
            Marginal(n, kind, arguments, p) for n, arguments, p in zip(names, columns, points, strict=True)
        ), kind

    def _arguments(self, path: str, kind: str, value: Any, rule: Numbers) -> list[list[float]] | None:
        """Return the numbers of each argument, flattened to the key's components."""
        distribution = DISTRIBUTIONS[kind]
        rules, expected = [make(rule) for make in distribution.rules], distribution.expected
        values = [value] if kind == RELATIVE else value
        if not isinstance(values, list | tuple) or len(values) != len(rules):
            self.refuse(value, f"{expected}, each {rule.words}", path)
            return None
        one_for_all = [make in (_spread, _share) for make in distribution.rules]
        try:
            found = [_read(*each) for each in zip(rules, values, one_for_all, strict=True)]
            rows = [components(one, rule.shape) for one in found]
        except ValueError as error:
            self.refuse(value, f"{expected}: {error}", path)
            return None
        if distribution.ascending and any(list(c) != sorted(c) for c in zip(*rows, strict=True)):
            self.refuse(value, f"{expected} in ascending order", path)
            return None
        return rows

    def _points(self, path: str, value: Any, shape: tuple[int, ...]) -> list[int] | None:
        count = len(component_names("", shape))
        each = list(value) if isinstance(value, list | tuple) else [value] * count
        whole = all(isinstance(n, int) and not isinstance(n, bool) and 0 <= n <= 10**6 for n in each)
        if not whole or len(each) != count:
            several = f", or {count} of them" if count > 1 else ""
            self.refuse(value, f"a number of points of the grid{several}", path)
            return None
        return each

    # Inertia, attitude, shape

    def _inertia(self) -> Found:
        value = self.value
        if not isinstance(value, Mapping) or not value:
            return self._distribution(self.path, value, INERTIA, Numbers((3,), "kg m2"))
        found: Found = (), ""
        if set(value) != {AXES}:
            kind = next((kind for kind in DISTRIBUTIONS if kind in value), "")
            shape = (3, 3) if kind and _nested(value[kind], 3) else (3,)
            if len(shape) == 2 and AXES in value:
                self.refuse(value, f"principal moments, or no {AXES}: a matrix has its axes")
            found = self._distribution(self.path, value, INERTIA, Numbers(shape, "kg m2"), beside=(AXES,))
        axes = self._normal_about_zero(AXES, value[AXES], "deg") if AXES in value else ()
        return (*found[0], *axes), found[1]

    def _attitude(self) -> Found:
        value = self.value
        if value == UNIFORM:
            names = component_names(f"{ATTITUDE}.{UNIFORM}", (3,))
            return tuple(Marginal(name, UNIFORM, (0.0, 1.0)) for name in names), UNIFORM
        if isinstance(value, Mapping) and set(value) <= {*VARYING_ANGLES, *ABOUT, "euler"}:
            given = [key for key in value if key != "euler"]
            if len(given) == 1 and ("euler" in value) == given[0].startswith("angles"):
                return self._angles(given[0], value)
        ways = '"uniform", { rotvec_deg = 2.0 } about the scene\'s, or { euler = "ZYX", angles_deg = { normal = ... } }'
        return self.refuse(value, f"{ways}, or {{ rotvec = {{ normal = ... }} }}")

    def _angles(self, name: str, value: Mapping[str, Any]) -> Found:
        if name in ABOUT and not isinstance(value[name], Mapping):
            return self._normal_about_zero(name, value[name], ABOUT[name]), f"about {name}"
        if "euler" in value:
            try:
                Attitude._rules["euler"](value["euler"])
            except ValueError as error:
                return self.refuse(value["euler"], str(error), f"{self.path}.euler")
        rule = Attitude._rules[name if name in VARYING_ANGLES else "rotvec"]
        assert isinstance(rule, Numbers)
        path = f"{self.path}.{name}"
        found, _ = self._distribution(path, value[name], f"{ATTITUDE}.{name}", rule, relative=False)
        return found, name

    def _normal_about_zero(self, name: str, value: Any, unit: str) -> tuple[Marginal, ...]:
        """Return the marginals of a rotation vector, given their standard deviations."""
        path = f"{self.path}.{name}"
        rule = Numbers((3,), unit, " >= 0: standard deviations, or one for all", NOT_NEGATIVE[1])
        spread = self._constants(path, value, rule, one_for_all=True)
        names = component_names(f"{self.key}.{name}", (3,))
        return tuple(Marginal(n, NORMAL, (0.0, s)) for n, s in zip(names, spread, strict=False))

    def _constants(self, path: str, value: Any, rule: Numbers, one_for_all: bool = False) -> list[float]:
        """Return a key's numbers one after another, none where they are refused."""
        try:
            return components(_read(rule, value, one_for_all), rule.shape)
        except ValueError as error:
            self.refuse(value, str(error), path)
            return []

    def _shape(self) -> Found:
        value = self.value
        kind = value.get("kind") if isinstance(value, Mapping) else None
        if not isinstance(kind, str) or kind not in SHAPES:
            return self.refuse(value, f"a table with kind out of {', '.join(SHAPES)}, and its sizes")
        section = SHAPES[kind]
        keys = section.sizes()
        if set(value) != {"kind", *keys}:
            return self.refuse(value, f"a {kind} with {' and '.join(keys)}")
        found: tuple[Marginal, ...] = ()
        for key in keys:
            found += self._size(key, value[key], section._rules[key])
        return found, kind

    def _size(self, key: str, value: Any, rule: Rule) -> tuple[Marginal, ...]:
        assert isinstance(rule, Numbers)
        path, name = f"{self.path}.{key}", f"{SHAPE}.{key}"
        if isinstance(value, Mapping):
            return self._distribution(path, value, name, rule, relative=False)[0]
        row = self._constants(path, value, rule)
        return tuple(Marginal(n, FIXED, (x,)) for n, x in zip(component_names(name, rule.shape), row, strict=False))


def _read(rule: Numbers, value: Any, one_for_all: bool) -> Any:
    """Return the numbers; one number stands for a vector of equal ones where that is allowed."""
    value = plain(value)
    if one_for_all and rule.shape and not isinstance(value, list | tuple):
        value = np.full(rule.shape, Numbers((), rule.unit, rule.bound, rule.holds)(value))
    return rule(value)


def _nested(value: Any, levels: int) -> bool:
    """Return whether lists stand within lists, so many levels deep."""
    return isinstance(value, list | tuple) and (levels == 1 or any(_nested(item, levels - 1) for item in value))
