"""The series of every operation, in doubles by generated kernels and in double-double ones, against 40 digits."""

import math

import mpmath
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from rbfmu.formulas.functions import Table
from rbfmu.formulas.graph import Graph, Symbol, changes_of, gradient, numbers_of, numbers_or_nan
from rbfmu.formulas.program import PAIRS, Program, pair_of, with_pairs
from rbfmu.formulas.source import source_of, source_of_lanes
from rbfmu.formulas.text import value_of
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.integrators import formula_reference as reference
from rbfmu_kernels.integrators.formula_operations import KINDS

TABLE = Table.through((0.0, 1.0, 2.0), (1.0, 3.0, 2.0), cubic=True)
CASES = {
    "add": ("sin(t) + t", lambda t: mpmath.sin(t) + t),
    "subtract": ("1 - cos(t)", lambda t: 1 - mpmath.cos(t)),
    "multiply": ("t*sin(t)", lambda t: t * mpmath.sin(t)),
    "square": ("sin(t)**2", lambda t: mpmath.sin(t) ** 2),
    "divide": ("sin(t)/(2 + cos(t))", lambda t: mpmath.sin(t) / (2 + mpmath.cos(t))),
    "divide a constant": ("c/(1 + t)", lambda t: 0.7 / (1 + t)),
    "divide by a constant": ("t*t/c", lambda t: t * t / mpmath.mpf(0.7)),
    "sqrt": ("sqrt(2 + sin(t))", lambda t: mpmath.sqrt(2 + mpmath.sin(t))),
    "tanh": ("tanh(30*t - 3)", lambda t: mpmath.tanh(30 * t - 3)),
    "exp": ("exp(-t*t)", lambda t: mpmath.exp(-t * t)),
    "logistic": ("1/(1 + exp(-3*t))", lambda t: 1 / (1 + mpmath.exp(-3 * t))),
    "logistic of what is large": ("t + t/(1 + exp(9e3*(t - 0.6)))", lambda t: 2 * t if t < 0.6 else t),
    "logistic the other way": ("2*exp(t*t)/(1 + exp(t*t))", lambda t: 2 / (1 + mpmath.exp(-t * t))),
    "log": ("log(2 + t*t)", lambda t: mpmath.log(2 + t * t)),
    "sin and cos of one angle": ("sin(t*t)*cos(t*t)", lambda t: mpmath.sin(t * t) * mpmath.cos(t * t)),
    "tan": ("tan(0.3*t)", lambda t: mpmath.tan(mpmath.mpf(0.3) * t)),
    "asin": ("asin(0.5*sin(t))", lambda t: mpmath.asin(mpmath.sin(t) / 2)),
    "acos": ("acos(0.5*sin(t))", lambda t: mpmath.acos(mpmath.sin(t) / 2)),
    "atan2": ("atan2(sin(t), 2 + t)", lambda t: mpmath.atan2(mpmath.sin(t), 2 + t)),
    "atan2 of a constant": ("atan2(t, 2)", lambda t: mpmath.atan2(t, 2)),
    "power": ("(2 + sin(t))**1.3", lambda t: (2 + mpmath.sin(t)) ** mpmath.mpf(1.3)),
    "power of a constant": ("(2 + sin(t))**c", lambda t: (2 + mpmath.sin(t)) ** mpmath.mpf(0.7)),
    "power that changes": ("(2 + t)**sin(t)", lambda t: (2 + t) ** mpmath.sin(t)),
    "whole power": ("(2 + t)**-7", lambda t: (2 + t) ** -7),
    "large whole power": ("(t - 1.9)**65", lambda t: (t - mpmath.mpf(1.9)) ** 65),
    "half power": ("(2 + t)**2.5", lambda t: (2 + t) ** mpmath.mpf(2.5)),
    "norm": ("norm([t, 1, sin(t)])", lambda t: mpmath.sqrt(t * t + 1 + mpmath.sin(t) ** 2)),
    "abs": ("abs(sin(t) - 2)", lambda t: 2 - mpmath.sin(t)),
    "where": ("where(t > 0.1, exp(t), cos(t))", lambda t: mpmath.exp(t) if t > 0.1 else mpmath.cos(t)),
    "min, max, clip": ("min(t, 5) + max(t, -1) + clip(2*t, -9, 9)", lambda t: 4 * t),
    "table": ("table(ramp, t)", lambda t: 1 + mpmath.mpf(2.75) * t - mpmath.mpf(0.75) * t**3),
}
POINTS = (0.4, 0.9)
N = 12
NOTHING = np.zeros((1, 3), np.int64)
PLACES = ("c", "t", "y", "slope", "series.resting", "series.sides")
"""What stands in the buffer of these tests."""


def graph_of(text):
    graph = Graph({"c": 0.7})
    names = {"t": graph.leaf("state", "t"), "y": graph.leaf("state", "y"), "c": graph.leaf("place", "c"), "ramp": TABLE}
    return graph, value_of(text, names)


def truth(function, t, n=N):
    with mpmath.workdps(40):
        return [mpmath.mpf(x) for x in mpmath.taylor(function, mpmath.mpf(t), n)]


def doubles(text, t, n=N, in_lanes=False):
    """Coefficients of a function of t, as those of the rate of y."""
    graph, y = graph_of(text)
    made = Program(graph, {"y": y, "t": 1.0}, {})
    kernels = {}
    if in_lanes:
        source, row = source_of_lanes(made, PLACES.index)
    else:
        source, row = source_of(made, PLACES.index, {}), made.row
    exec(source, kernels)
    work = 40
    z = np.zeros(work + made.start + (n + 3) * row)
    z[0] = 0.7
    rows = z[work + made.start :].reshape(-1, row)
    rows[0, 1] = t
    for at, i in enumerate(made.sides, PLACES.index("series.sides")):
        z[at] = float(truth_of(graph, Symbol(graph, i), t))
    interpreted(kernels["constants"])(z, work)
    interpreted(kernels["first"])(z, work)
    for k in range(1, n + 1):
        interpreted(kernels["further"])(z, work, k)
    return [(k + 1) * rows[k + 1, 0] for k in range(n + 1)]


def truth_of(graph, x, t):
    """The value of a number that comes of t by sums, products and functions, in Python's own arithmetic."""
    kind, of, value = x.operation
    parts = [truth_of(graph, Symbol(graph, i), t) for i in of]
    simple = {"add": lambda a, b: a + b, "subtract": lambda a, b: a - b, "multiply": lambda a, b: a * b,
              "sin": mpmath.sin, "cos": mpmath.cos, "side": mpmath.sign,
              "select": lambda side, a, b: a if side > 0 else b}  # fmt: skip
    return t if kind == "state" else value if kind == "number" else 0.7 if kind == "place" else simple[kind](*parts)


def equations(operations=NOTHING, states=NOTHING, least=(0.0,)):
    """What the reference walks, of one group of states, without sides."""
    return reference.Equations(
        operations, states, np.array(least), np.zeros((0, 3)), NOTHING[:0], NOTHING[0, :0], NOTHING[0], -1
    )


def double_doubles(text, t, n=N):
    graph, y = graph_of(text)
    one = graph.symbol_of(1.0)
    found = with_pairs(graph, [y, one, graph.leaf("state", "t")])
    place = {i: k for k, i in enumerate(found)}
    operations = np.zeros((len(found), 5), np.int64)
    s = np.zeros((2, len(found) * reference.LENGTH))
    for k, i in enumerate(found):
        kind, of, value = graph.operations[i]
        if kind in PAIRS:
            of = (of[0], pair_of(graph, i).index)
        operations[k] = [KINDS.index(kind), *(place[j] for j in of), *[0] * (3 - len(of)), 1]
        s[0, k * reference.LENGTH] = {"number": value, "state": t, "place": 0.7}.get(kind, 0.0)
    states = np.array([[place[graph.leaf("state", "t").index], place[one.index], 0]])
    for k, i in enumerate(found):
        if graph.operations[i].kind == "side":
            s[0, k * reference.LENGTH] = float(truth_of(graph, Symbol(graph, i), t))
    interpreted(reference.expand)(equations(operations, states), s, 1.0)
    at = place[y.index] * reference.LENGTH
    return [mpmath.mpf(s[0, at + k]) + mpmath.mpf(s[1, at + k]) for k in range(n + 1)]


def errors(found, expected):
    """Of coefficients, relative to the size of the series where it is no longer than its reach."""
    radius = max(float(abs(x)) ** (1.0 / k) for k, x in enumerate(expected) if k) or 1.0
    size = max(float(abs(x)) / radius**k for k, x in enumerate(expected))
    return (
        max(float(abs(mpmath.mpf(a) - b)) / radius**k for k, (a, b) in enumerate(zip(found, expected, strict=True)))
        / size
    )


@pytest.mark.parametrize(("series", "enough"), [(doubles, 3e-13), (double_doubles, 1e-26)])
@pytest.mark.parametrize("name", CASES)
def test_series_are_those_of_40_digits(name, series, enough):
    text, function = CASES[name]
    for t in POINTS:
        with mpmath.workdps(40):
            assert errors(series(text, t), truth(function, t)) <= enough


def test_series_that_are_written_for_lanes_have_the_same_bits():
    """Of plain numbers; members of ensembles go through them side by side."""
    for name, (text, _) in CASES.items():
        assert doubles(text, POINTS[0], in_lanes=True) == doubles(text, POINTS[0]), name


@pytest.mark.parametrize("name", [n for n in CASES if n not in ("power that changes",)])
def test_gradients_are_first_coefficients(name):
    """By one sweep backwards; of what the other tests have by series."""
    text, function = CASES[name]
    graph, y = graph_of(text)
    (slope,) = gradient(y, [graph.leaf("state", "t")])
    kernels = {}
    exec(source_of(Program(graph, {"y": slope, "t": 1.0}, {"slope": slope}), PLACES.index, {}), kernels)
    for t in POINTS:
        z = np.array([0.7, t, 0.0, 0.0])
        assert interpreted(kernels["values"])(z) == 0
        assert z[3] == pytest.approx(float(truth(function, t, 1)[1]), rel=1e-13, abs=1e-14)


@pytest.mark.parametrize(("text", "slopes"), [
    ("t**1.5", (0.0, 1.5)), ("max(t, 0)**2.5", (0.0, 2.5)), ("3*sqrt(4*t)**3", (0.0, 36.0)), ("sqrt(t)**2", (1.0, 1.0)),
    ("max(t, 0)**1.7", (0.0, 1.7)),
])  # fmt: skip
def test_a_power_has_a_slope_where_it_is_zero(text, slopes):
    """By products and root it was 0/0 there."""
    graph, y = graph_of(text)
    (slope,) = gradient(y, [graph.leaf("state", "t")])
    found = [numbers_of(graph, [slope], {"t": t})[0] for t in (0.0, 1.0)]
    assert found == pytest.approx(slopes, rel=1e-15)


@pytest.mark.parametrize("text", [
    "where(t > 0, sqrt(t), 3*t)", "where(t <= 0, 3*t, 2 - log(t))", "where(t > 0, 2*t**0.3, 3*t)",
    "3*t + where(t > 0, sqrt(t)*4, 0)", "where(t > -2, where(t > 0, 1/(t + abs(t)), t), 1)*3",
    "3*where(0 < t, [t, asin(t + 1), 0], [1, t, 0])[2]",
])  # fmt: skip
def test_what_is_not_selected_is_in_no_slope(text):
    """2026-12-01: it was, times zero, which is not a number where that is infinite or a root of less than zero."""
    graph, y = graph_of(text)
    t = graph.leaf("state", "t")
    assert numbers_or_nan(graph, [*gradient(y, [t]), *changes_of([y], {t: 1.0})], {"t": -1.0}) == [3.0, 3.0]


@pytest.mark.parametrize(
    "text", ["sqrt(t)", "norm([t, 0, t*t])", "log(t)", "1/t", "t**0.5", "t**1.3", "t**-0.3", "atan2(t, t)"]
)
def test_beside_singular_points_numbers_are_exact_or_not_finite(text):
    """At zero the series of a quotient or a logarithm is not finite, which the step refuses; roots count as zero."""
    with np.errstate(all="ignore"):
        found = [float(x) for x in doubles(text, np.float64(0.0), 4)]
    if any(root in text for root in ("sqrt", "norm", "0.5", "1.3")):
        assert found == [0.0] * 5
    else:
        assert not np.isfinite(found).all()
    for t in (1e-8, 1e-3):
        function = {
            "sqrt(t)": mpmath.sqrt, "log(t)": mpmath.log, "1/t": lambda t: 1 / t, "t**0.5": mpmath.sqrt,
            "t**1.3": lambda t: t ** mpmath.mpf(1.3), "norm([t, 0, t*t])": lambda t: t * mpmath.sqrt(1 + t * t),
            "t**-0.3": lambda t: t ** mpmath.mpf(-0.3), "atan2(t, t)": lambda t: mpmath.pi / 4 + 0 * t,
        }[text]  # fmt: skip
        with mpmath.workdps(60):
            true = [function(mpmath.mpf(t)), mpmath.diff(function, mpmath.mpf(t))]
            found = doubles(text, t, 1)
            assert float(abs(found[0] - true[0])) <= 1e-14 * max(float(abs(true[0])), 1e-300)
            assert float(abs(found[1] - true[1])) <= 1e-13 * max(float(abs(true[1])), 1.0)


@pytest.mark.parametrize(
    ("least", "largest", "size"),
    [(0.0, 0.0, 3.0), (2.0, 0.0, 3.0), (7.0, 0.0, 7.0), (0.0, 5.0, 5.0), (-2.0, 5.0, 2.0), (-7.0, 0.0, 7.0)],
)
def test_steps_of_the_reference_keep_the_last_terms_small_beside_the_size_of_a_state(least, largest, size):
    """The state is 3 now and has been `largest`; the size is negative where it alone counts, and not the state."""
    s, order, sizes = np.zeros((2, reference.LENGTH)), reference.ORDER, np.array([largest])
    s[0, 0], s[0, order] = 3.0, 0.5
    longest = interpreted(reference.longest_step)(equations(least=[least]), sizes, s)
    assert longest == pytest.approx((reference.TOLERANCE * size / 0.5) ** (1.0 / order), rel=1e-14)
    s[0, order - 1] = 40.0  # the last term but one counts as well
    longest = interpreted(reference.longest_step)(equations(least=[least]), sizes, s)
    assert longest == pytest.approx((reference.TOLERANCE * size / 40.0) ** (1.0 / (order - 1)), rel=1e-14)
    for place in (0, 1, 4, order):
        spoiled = s.copy()
        spoiled[0, place] = math.nan
        assert math.isnan(interpreted(reference.longest_step)(equations(least=[least]), sizes, spoiled))


@pytest.mark.parametrize("first", [1, 2, 3, 9, reference.ORDER - 2])
def test_a_state_that_begins_at_zero_has_the_size_that_its_first_terms_make(first):
    s, order = np.zeros((2, reference.LENGTH)), reference.ORDER
    s[0, first], s[0, order] = 0.5, 0.25
    longest = interpreted(reference.longest_step)(equations(), np.zeros(1), s)
    assert longest == pytest.approx((reference.TOLERANCE * 0.5 / 0.25) ** (1.0 / (order - first)), rel=1e-14)


@pytest.mark.parametrize(("text", "made"), [
    ("c*sin(t) + t**0.3", "add(multiply(c, sin(t)), power(t, 0.3))"), ("(2*t)*(3*y)", "multiply(6.0, multiply(t, y))"),
    ("(c*t)*y", "multiply(c, multiply(t, y))"),
    ("t*(c*y)", "multiply(c, multiply(t, y))"),
    ("2*(c*t)", "multiply(multiply(2.0, c), t)"),
    ("c*(c*t)", "multiply(multiply(c, c), t)"),
    ("t*(-y) + t*y", "0.0"),
    ("2*t*y - c*y*t", "multiply(subtract(2.0, c), multiply(t, y))"),
    ("t - (-y)", "add(t, y)"), ("t + (-y)", "subtract(t, y)"), ("-t + y", "subtract(y, t)"),
])  # fmt: skip
def test_products_that_differ_by_a_constant_are_made_once(text, made):
    assert repr(graph_of(text)[1]) == made


X, Y = (-1.0, 0.5, 2.0, 2.25, 4.0), (3.0, -1.0, 0.5, 0.25, 7.0)
AROUND = [*np.linspace(-3.0, 6.0, 46), *X]


@pytest.mark.parametrize("points", [2, 3, 5])
def test_tables_are_lines_or_a_natural_spline_and_stay_at_their_ends_beyond_them(points):
    x, y = X[:points], Y[:points]
    lines, spline = Table.through(x, y, cubic=False), Table.through(x, y, cubic=True)
    assert [lines.at(t) for t in AROUND] == pytest.approx(np.interp(AROUND, x, y), rel=1e-14, abs=1e-14)
    expected = CubicSpline(x, y, bc_type="natural")(np.clip(AROUND, x[0], x[-1]))
    assert [spline.at(t) for t in AROUND] == pytest.approx(expected, rel=1e-13, abs=1e-13)
