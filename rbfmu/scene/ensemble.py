"""The table `[ensemble]` of a scene: the number of runs, which numbers vary and how, and their correlations."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np

from rbfmu.scene import body as bodies, own as named, section as rules, variations
from rbfmu.scene.variations import ATTITUDE, AXES, INERTIA, RELATIVE, SHAPE, VARYING_ANGLES, Marginal, Variation

Rows = tuple[tuple[float, ...], ...]
NO_VARIANCE, NO_COVARIANCE = 1e-10, 1e-5
"""The largest numbers that count as zero in the Cholesky factorization of correlations: NO_VARIANCE for the remaining
variance (of 1) of a component after subtracting earlier ones, NO_COVARIANCE for its remaining covariance with others.

Correlations are written with few digits, so that a dependent component is only nearly dependent. The remaining matrix
of a semidefinite matrix is semidefinite, and its entries are at most the square root of the product of two variances.
So the second number is the square root of the first.
"""


def _component_names(value: object) -> tuple[str, ...] | None:
    given = rules.texts(value) or ()
    return given if 2 <= len(given) == len(set(given)) else None


def _square(value: object) -> Rows | None:
    """Return the rows of a symmetric matrix."""
    value = rules.plain(value)
    if not isinstance(value, list | tuple) or not value:
        return None
    rows: Rows = tuple(rules.Numbers((len(value),))(row) for row in value)
    sizes = [abs(x) for row in rows for x in row]
    for i, j in np.argwhere(np.tri(len(rows), k=-1)).tolist():
        if not math.isclose(rows[i][j], rows[j][i], abs_tol=1e-12 * max(sizes)):
            raise ValueError(f"a symmetric matrix; rows {i + 1} and {j + 1} differ")
    return rows


_COMPONENTS = rules.Rule(
    'a list of at least two distinct numbers that vary, such as ["body.mass", "loads.torque_b[2]"]', _component_names
)
_SQUARE = rules.Rule("a symmetric matrix: a list of rows of finite numbers", _square)


class Correlation(rules.Section, path="ensemble.correlation"):
    """The numbers that depend on each other, and their correlations or covariances."""

    meaning: ClassVar[str] = "which of these numbers depend on each other"
    components: Annotated[tuple[str, ...], _COMPONENTS.means("numbers that depend on each other")]
    matrix: Annotated[
        Rows | None, _SQUARE.means("their correlations; for numbers that are not normal, of their normal scores")
    ] = None
    covariance: Annotated[Rows | None, _SQUARE.means("covariances in place of matrix, of normal numbers")] = None

    def _contradictions(self) -> Iterator[str]:
        given = [name for name in ("matrix", "covariance") if getattr(self, name) is not None]
        if len(given) != 1:
            yield rules.fault(self._path, list(given), "either matrix (of correlations) or covariance")
            return
        rows, path, n = getattr(self, given[0]), f"{self._path}.{given[0]}", len(self.components)
        if len(rows) != n:
            yield rules.fault(path, rows, f"{n} rows of {n} numbers, as components has")
        elif any(rows[i][i] <= 0.0 for i in range(n)):
            yield rules.fault(path, rows, "numbers > 0 on the diagonal")
        elif self.matrix is not None and any(rows[i][i] != 1.0 for i in range(n)):
            yield rules.fault(path, rows, "1 on the diagonal; or the key covariance")
        elif lower_factor(self.correlations) is None:
            yield rules.fault(path, rows, "a positive semidefinite matrix; these correlations contradict each other")

    @property
    def correlations(self) -> Rows:
        """Return the matrix of correlations."""
        if self.matrix is not None:
            return self.matrix
        assert self.covariance is not None
        spread = [math.sqrt(row[i]) for i, row in enumerate(self.covariance)]
        return tuple(
            tuple(1.0 if i == j else x / spread[i] / spread[j] for j, x in enumerate(row))
            for i, row in enumerate(self.covariance)
        )


def lower_factor(matrix: Sequence[Sequence[float]]) -> list[list[float]] | None:
    """Return the lower triangular L (n, n) with L L^T equal to a matrix of correlations; None if not semidefinite.

    It is Cholesky's factor, with a column of zeros where a component depends on those before it. It is computed with
    Python's floats, so that its bits are the same on every machine.
    """
    n = len(matrix)
    L = [[0.0] * n for _ in range(n)]
    for j in range(n):
        square = matrix[j][j] - math.fsum(x * x for x in L[j][:j])
        if square < -NO_VARIANCE:
            return None
        dependent = square <= NO_VARIANCE
        L[j][j] = 0.0 if dependent else math.sqrt(square)
        for i in range(j + 1, n):
            rest = matrix[i][j] - math.fsum(x * y for x, y in zip(L[i][:j], L[j][:j], strict=True))
            if dependent and abs(rest) > NO_COVARIANCE:
                return None
            L[i][j] = 0.0 if dependent else rest / L[j][j]
    return L


RANDOM, SOBOL, LATIN_HYPERCUBE, GRID = DESIGNS = ("random", "sobol", "latin_hypercube", "grid")
CHOICE = " or ".join(f'"{name}"' for name in DESIGNS)
NESTED = ("body", "initial", "loads", "run", *named.PARAMETER_END)
MOST_RUNS = 1_000_000_000


_KEPT = rules.names(("final", "statistics", "all"), least=1)
_KEEP = rules.Rule(_KEPT.words, lambda x: _KEPT([x] if isinstance(x, str) else x), _KEPT.choice).means(
    'what is kept: of each run its end ("final") or all of it, and statistics over time'
)
_VARY = rules.Rule(
    'a table: keys of the scene, each with a distribution, such as "body.mass" = { normal = [50.0, 0.5] }',
    variations.read_variations,
)


class Ensemble(rules.Section, path="ensemble"):
    """Runs of one scene in which some of its numbers vary."""

    runs: Annotated[int, rules.whole(1, MOST_RUNS).means("number of runs; of a grid: that of its points")] = 1000
    seed: Annotated[int, rules.whole(0, 2**63 - 1).means("run i depends on seed and i alone")] = 0
    design: Annotated[str, rules.one_word(DESIGNS, CHOICE).means("how values are drawn: " + CHOICE)] = RANDOM
    keep: Annotated[tuple[str, ...], _KEEP] = ("final", "statistics")
    vary: Annotated[tuple[Variation, ...], _VARY.means("what varies: keys of the scene, each a distribution")]
    correlation: Correlation | None = None

    @property
    def varying(self) -> tuple[Marginal, ...]:
        """Return the distributions of all numbers that vary."""
        return tuple(m for variation in self.vary for m in variation.marginals if m.varies)

    def variation_of(self, key: str) -> Variation | None:
        """Return the variation of a key, or None."""
        return next((variation for variation in self.vary if variation.key == key), None)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of the parameters whose values vary, as `inputs.parameters` lists them."""
        keys = [variation.key for variation in self.vary]
        names = (named.parameter_of(key) if named.is_own(key) else variations.QUANTITY_OF[key].name for key in keys)
        return tuple(dict.fromkeys(names))

    def _non_defaults(self) -> dict[str, object]:
        """Return the fields that differ from the defaults, tables as in the file."""
        tables = self.table()
        return {name: tables.get(name, value) for name, value in super()._non_defaults().items()}

    def table(self) -> dict[str, Any]:
        """Return the table from which an equal ensemble can be made."""
        return super().table() | {"vary": {variation.key: variation.table for variation in self.vary}}

    def _contradictions(self) -> Iterator[str]:
        if self.design == GRID and "runs" not in self._given:  # as many as points
            vars(self)["runs"] = min(math.prod(m.points or 1 for m in self.varying), MOST_RUNS)
        if not self.varying:  # a shape may be fixed beside a mass that varies
            yield self.vary[0].refused("a distribution in which something varies")
        yield from self._faults_of_grid()
        if self.correlation is not None:
            yield from self._faults_of_correlation(self.correlation)
        of_rates, own = self.variation_of(variations.DEGREES), self.variation_of(INERTIA)
        if of_rates and self.variation_of("initial.omega_b"):
            yield of_rates.refused("initial.omega_b or this, not both")
        if self.variation_of(SHAPE) and own and own.form not in ("", RELATIVE):
            yield own.refused(f"{RELATIVE} or {AXES}: the inertia follows from {SHAPE}")

    def _faults_of_grid(self) -> Iterator[str]:
        is_grid = self.design == GRID
        for variation in self.vary:
            wrong = [m for m in variation.marginals if (m.varies and not m.points if is_grid else m.points)]
            if wrong and is_grid:
                yield _fault_of_points(variation, wrong[0])
            elif wrong:
                yield variation.refused('points in a grid alone: design = "grid"')
        count = math.prod(m.points or 1 for m in self.varying)
        if is_grid and count > MOST_RUNS:
            yield f"ensemble.vary: a grid of {count} points: expected at most {MOST_RUNS}"
        elif is_grid and count != self.runs:
            yield rules.fault("ensemble.runs", self.runs, f"no such key, or {count}: the points of the grid")

    def _faults_of_correlation(self, correlation: Correlation) -> Iterator[str]:
        known = {m.name: m for m in self.varying if ".uniform[" not in m.name}
        if self.design == GRID:
            expected = "none: the points of a grid are independent"
            yield rules.fault("ensemble.correlation", correlation.components, expected)
        if unknown := [name for name in correlation.components if name not in known]:
            expected = f"numbers that vary, out of {', '.join(known)}"
            yield rules.fault("ensemble.correlation.components", unknown, expected)
        elif correlation.covariance is not None:
            for k, (name, row) in enumerate(zip(correlation.components, correlation.covariance, strict=False)):
                is_normal = known[name].kind == variations.NORMAL
                if not (is_normal and math.isclose(row[k], known[name].arguments[1] ** 2, rel_tol=1e-6)):
                    expected = f"the square of the standard deviation of {name}, which is normal; or the key matrix"
                    yield rules.fault("ensemble.correlation.covariance", row[k], expected)


def _fault_of_points(variation: Variation, marginal: Marginal) -> str:
    """Return the fault of a number in a grid that has no points, or that cannot have any."""
    if marginal.name.startswith(f"{INERTIA}.{AXES}["):
        return variation.refused("no such key in a grid", AXES)
    if variation.key == ATTITUDE and variation.form not in VARYING_ANGLES:
        return variation.refused(f"no such key in a grid; or {', '.join(VARYING_ANGLES)}, which may have points")
    return variation.refused("points = the number of values in the grid, at least 1")


# The ensemble and the rest of its scene


def as_written(value: object, tables: Mapping[str, object], faults: list[str]) -> object:
    """Return the ensemble's table, completed by what the scene itself says: a shape, a sequence of angles.

    If mass or sizes vary, a member's inertia follows from the shape, as it would in the member's own scene file.
    faults: a fault is added for each key that is given twice.
    """
    if isinstance(value, Ensemble) and any(isinstance(tables.get(name), Mapping) for name in ("body", "initial")):
        value = value.table()
    if not isinstance(value, Mapping) or not isinstance(vary := value.get("vary"), Mapping):
        return value
    vary = _with_shape(_by_dotted_key(vary, faults), tables.get("body"), faults)
    return {**value, "vary": _with_own_vectors(_with_attitude(vary, tables.get("initial")), tables)}


def _by_dotted_key(vary: Mapping[str, object], faults: list[str]) -> dict[str, object]:
    """Return the table with one dotted key for each quantity, also where TOML reads dots as nested tables."""
    found: dict[str, object] = {}
    for key, value in vary.items():
        items = {key: value}
        if isinstance(value, Mapping) and (
            key in NESTED
            or (key == SHAPE and "kind" not in value)
            or (key == ATTITUDE and [*value] in (["angles"], ["angles_deg"]))
        ):
            items = _by_dotted_key({f"{key}.{name}": item for name, item in value.items()}, faults)
        faults += [_fault_of_two(name, item, found[name]) for name, item in items.items() if name in found]
        found = found | items
    return found


def _fault_of_two(key: str, value: object, other: object) -> str:
    return rules.fault(rules.joined("ensemble.vary", key), value, f"this or {rules.as_toml(other)}, not both")


def _with_shape(vary: dict[str, object], body: object, faults: list[str]) -> dict[str, object]:
    shape = body.get("shape") if isinstance(body, Mapping) else None
    if not isinstance(shape, Mapping):
        return vary
    sizes = {key: vary[key] for key in vary if str(key).startswith(f"{SHAPE}.")}
    known = vary.get(SHAPE)
    if known is not None:
        faults += [_fault_of_two(key, size, known) for key, size in sizes.items()]
    is_fixed = isinstance(known, Mapping) and not any(isinstance(size, Mapping) for size in known.values())
    if sizes or is_fixed or (known is None and "body.mass" in vary and not _is_absolute(vary.get(INERTIA))):
        varied = {str(key).removeprefix(f"{SHAPE}."): size for key, size in sizes.items()}
        vary = {key: item for key, item in vary.items() if key not in sizes} | {SHAPE: {**shape, **varied}}
    return vary


def _is_absolute(own: object) -> bool:
    return isinstance(own, Mapping) and not set(own) <= {RELATIVE, AXES, "points"}


def _with_attitude(vary: dict[str, object], initial: object) -> dict[str, object]:
    attitude = initial.get("attitude") if isinstance(initial, Mapping) else None
    for name in VARYING_ANGLES:
        key = f"{ATTITUDE}.{name}"
        if not isinstance(attitude, Mapping) or ATTITUDE in vary or key not in vary:
            continue
        if name == "rotvec" or "euler" in attitude:
            sequence = {} if name == "rotvec" else {"euler": attitude["euler"]}
            vary = dict((ATTITUDE, {**sequence, name: x}) if k == key else (k, x) for k, x in vary.items())
    return vary


def _with_own_vectors(vary: dict[str, object], tables: Mapping[str, object]) -> dict[str, object]:
    """Return the table in which one relative number for a scene's own vector is repeated for its 3 components."""
    for key, item in vary.items():
        name, _, own = str(key).partition(".")
        table = tables.get(name) if named.is_own(str(key)) else None
        if isinstance(table, Mapping) and isinstance(item, Mapping) and isinstance(item.get(RELATIVE), float | int):
            entry = table.get(own)
            given = entry.get("value", entry.get("start")) if isinstance(entry, Mapping) else entry
            numbers = rules.plain(getattr(entry, "numbers", given))
            if isinstance(numbers, list | tuple) and len(numbers) == 3:
                vary = {**vary, key: {**item, RELATIVE: [item[RELATIVE]] * 3}}
    return vary


def without_idle_shape(ensemble: Ensemble, body: bodies.Body | None) -> Ensemble:
    """Return the ensemble without a shape that does not vary and is no longer the body's."""
    shape = ensemble.variation_of(SHAPE)
    if shape is None or body is None or any(m.kind != variations.FIXED for m in shape.marginals):
        return ensemble
    if bodies.SHAPES[shape.form].read(shape.table).inertia(body.mass) == body.inertia:
        return ensemble
    return ensemble._with(vary=tuple(variation for variation in ensemble.vary if variation is not shape))


def faults_with(ensemble: Ensemble, good: Mapping[str, Any]) -> Iterator[str]:
    """Yield the contradictions between an ensemble and the valid ones of the other tables of its scene."""
    body, inputs = good.get("body"), good.get("inputs")
    prescribed = inputs is not None and "omega_b" in inputs.ports
    for variation in ensemble.vary:
        name, _, key = variation.key.partition(".")
        table, own = good.get(name), named.is_own(variation.key)
        if prescribed and variation.key != ATTITUDE:
            yield variation.refused(f"{ATTITUDE} at most: the port omega_b prescribes the rates")
        elif variation.key == "initial.velocity" and body is not None and body.pivot:
            yield variation.refused("no such key: the pivot holds o")
        elif table is None:
            continue
        elif name == "loads" and key in table.made:
            yield variation.refused(named.OF_NUMBERS)
        elif own and key not in table:
            known = ", ".join(f"{name}.{key}" for key in table) or f"none: the scene has no {name}"
            yield variation.refused(f"a key out of {known}")
        elif own and len(table[key].numbers) != len(variation.marginals):
            three = "distributions of 3 numbers, such as { normal = [[0, 0, 0], 0.1] }"
            yield variation.refused(three if len(table[key].numbers) > 1 else "the distribution of 1 number")
        elif variation.is_relative and variation.key == INERTIA:
            if bodies.axis_without_moment(table.M_c) is not None:  # two equal moments would differ in a member
                yield variation.refused("body.mass, or the length of its shape: a beam's two moments are equal")
        elif variation.is_relative:
            relative = zip(variation.marginals, nominal_value(variation.key, good), strict=True)
            if zero := next((m.name for m, x in relative if m.varies and x == 0.0), ""):
                expected = f"0 for {zero}, as it is 0 in the scene; or a distribution that is not relative"
                yield variation.refused(expected, RELATIVE)


def nominal_value(key: str, sections: Mapping[str, Any]) -> list[float]:
    """Return the scene's numbers of a key, in SI units, but deg/s for `initial.omega_b_deg`."""
    table, _, name = key.partition(".")
    if named.is_own(key):
        return [*sections[table][name].numbers]
    value = getattr(sections[table], name.removesuffix("_deg"))
    found = variations.components(value, (3,) if isinstance(value, tuple) else ())
    return [math.degrees(x) for x in found] if key == variations.DEGREES else found
