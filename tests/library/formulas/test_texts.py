"""What formulas may say, what they mean, and what is said where they are wrong."""

import re
import string

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rbfmu.formulas.functions import FUNCTIONS, Table, shape_of
from rbfmu.formulas.graph import MOST_OPERATIONS, Graph
from rbfmu.formulas.text import DEEPEST, LONGEST, FormulaError, read, value_of

V, M = np.array([1.0, 2.0, 4.0], object), np.array([[1.0, 2.0, 3.0], [0.0, 1.0, 4.0], [5.0, 6.0, 0.0]], object)
NAMES = {"v": V, "M": M, "x": 0.5, "ramp": Table.through((0.0, 1.0, 3.0), (1.0, 2.0, 0.0), cubic=False)}


@pytest.mark.parametrize(("text", "expected"), [
    ("2*x + 1", 2.0),
    ("-x**2", -0.25),
    ("2**-2", 0.25),
    ("4**0.5", 2.0),
    ("v[3]/v[1]", 4.0),
    ("M[3,1]", 5.0),
    ("dot(v, v)", 21.0),
    ("norm(3*v - [0, 2, 12])", 5.0),
    ("cross([1,0,0], [0,1,0])", [0.0, 0.0, 1.0]),
    ("M @ v", [17.0, 18.0, 17.0]),
    ("(M @ M)[1,3]", 11.0),
    ("[x, 2*x, 3*x] + v", [1.5, 3.0, 5.5]),
    ("abs(-3) + min(1, 2) + max(1, 2) + clip(5, 0, 1)", 7.0),
    ("where(x > 1 or not x < 0.2, 1, 2)", 1.0),
    ("where(0 < x < 1 and x >= 0.5, v, 2*v)", [1.0, 2.0, 4.0]),
    ("180*deg/pi + 60*rpm/(2*pi)", 2.0),
    ("acos(0) + asin(1) + atan2(1, 0) - 1.5*pi", 0.0),
    ("tan(pi/4) + log(exp(2)) + sqrt(9)", 6.0),
    ("table(ramp, -1) + table(ramp, 0.5) + table(ramp, 2) + table(ramp, 9)", 3.5),
    ("\n  x\n  + 1\n", 1.5),
])  # fmt: skip
def test_formulas_mean_what_they_say(text, expected):
    np.testing.assert_allclose(np.array(value_of(text, NAMES), float), expected, rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize(("text", "column", "said"), [
    ("1 + (2*u)", 7, "in place of u"),
    ("v + x", 0, "equal shapes"),
    ("v*v", 0, "dot(a, b)"),
    ("M @ x", 0, "a matrix"),
    ("v[4]", 2, "1 to 3"),
    ("v[0]", 2, "1 to 3"),
    ("x[1]", 0, "no index"),
    ("sin(v)", 0, "a scalar"),
    ("cross(v, x)", 0, "a vector of 3 numbers"),
    ("dot(v)", 0, "dot(a, b)"),
    ("sine(x)", 0, "in place of sine()"),
    ("sin", 0, "sin(...)"),
    ("where(x, 1, 2)", 0, "a condition"),
    ("x > 1", 0, "where(condition, 1, 0)"),
    ("where(x > 1, x > 2, x)", 0, "a number"),  # 2026-11-24: a TypeError
    ("norm(x > 1)", 0, "a vector"),  # 2026-11-24: 1.0
    ("norm(x)", 0, "a vector"),
    ("dot(v, [x, x])", 0, "two vectors of one length"),
    ("ramp + 1", 0, "numbers on both sides"),
    ("table(x, 1)", 0, "the name of a table"),
    ("[v, 1]", 0, "rows of one length"),
    ("1, 2, 3", 0, "[ and ]"),
    ("x ^ 2", 0, "** for a power"),
    ("x // 2", 0, "/"),
    ("1 if x > 0 else 2", 0, "where(condition, a, b)"),
    ("x == 1", 0, "<"),
    ("v.x", 0, "a name or a number"),
    ("'a'", 0, "a number or a name"),
    ("True", 0, "a number or a name"),
    ("(lambda: 1)()", 1, "numbers, names"),
    ("__import__('os')", 0, "__import__()"),
    ("x +", 3, "a formula"),
    ("x + * 2", 4, "a formula"),
    ("é + (x ^ 2)", 5, "** for a power"),
    ("(-x)**0.3", 0, "a finite number"),
    ("1/0", 0, "a finite number"),
    ("sqrt(-1)", 0, "a finite number"),
    ("10.0**400", 0, "a finite number"),
    ("x" * (LONGEST + 1), LONGEST, f"at most {LONGEST} characters"),
    ("dot(v, [x, x", 7, "a closing bracket for this one"),
    ("dot(v, [x, x, x)", 7, "a closing bracket for this one"),
    ("x) + (x", 1, "an opening bracket for this one"),  # it was taken, for (x) + (x)
    ("(" * 50 + "x" + ")" * 50, DEEPEST, f"at most {DEEPEST} levels"),
    ("-" * 500 + "x", None, "operations inside each other"),
    ("x" + "+x" * 300, None, "operations inside each other"),
])  # fmt: skip
def test_mistakes_are_shown_with_a_caret(text, column, said):
    with pytest.raises(FormulaError) as caught:
        value_of(text, NAMES)
    first, shown, caret = str(caught.value).split("\n")
    assert said in first
    assert len(shown) <= 104
    if column is not None and len(text) < 100:
        assert caret.index("^") == 4 + column


@pytest.mark.parametrize(("text", "column"), [("1 + 2*(x ^ 3)", 7), ("x ^ 3", 0), ("1 + x // 3", 4), ("x // 3", 0)])
def test_an_operator_is_shown_where_it_stands_in_this_text(text, column):
    """2026-11-30: it was shown where it stood in the first text with it: Python has one object for an operator."""
    for shown in (text, f"{text} + 10"):
        with pytest.raises(FormulaError) as caught:
            read(shown)
        assert str(caught.value).split("\n")[2].index("^") == 4 + column


@pytest.mark.parametrize(
    ("before", "after", "column"), [("", "+x" * 70, 0), ("x+" * 35, "+x" * 35, 50), ("x+" * 70, "", 99)]
)
def test_of_a_long_text_a_hundred_characters_about_a_mistake_are_shown(before, after, column):
    with pytest.raises(FormulaError) as caught:
        value_of(f"{before}u{after}", NAMES)
    _, shown, caret = str(caught.value).split("\n")
    assert (len(shown), caret.index("^")) == (4 + 100, 4 + column)
    assert shown[4 + column] == "u"


def test_a_text_may_be_as_long_as_is_said():
    assert value_of(" " * (LONGEST - 1) + "1", NAMES) == 1.0


@pytest.mark.parametrize("text", ["x/0", "x*1e308*10"])
def test_infinite_factors_of_what_is_not_known_yet_are_shown(text):
    """2026-11-27: a torque omega_b/0 ended in a ZeroDivisionError, and others in a bare decimal.InvalidOperation."""
    with pytest.raises(FormulaError, match=f"expected a finite number\n    {re.escape(text)}"):
        value_of(text, {"x": Graph().leaf("state", "x")})


def test_formulas_that_come_to_too_many_operations_are_refused():
    graph = Graph()
    x = [graph.leaf("state", f"x[{k}]") for k in range(MOST_OPERATIONS - 1)]
    last = value_of("a * b", {"a": x[0], "b": x[1]})
    with pytest.raises(FormulaError, match=f"at most {MOST_OPERATIONS} operations\n    a \\* b"):
        value_of("a * b", {"a": x[0], "b": last})


TEXT = "dot(v, M @ cross(v, [x**2, 1, 0])) + where(x < 0, v[3], table(ramp, clip(x, 0, 4))) - atan2(x, sqrt(1 - x))"
KNOWN = string.ascii_letters + string.digits + "+-*/@()[]{},.<>=!&|~:;#'\"\\ \t\n\x00µ√"
CHANGES = st.tuples(st.integers(0, len(TEXT)), st.integers(0, 3), st.text(KNOWN, max_size=2))


@given(st.lists(CHANGES, min_size=1, max_size=4))
@settings(max_examples=400)
def test_mutated_texts_give_a_value_or_one_message(changes):
    text = TEXT
    for place, taken, put in changes:
        text = text[:place] + put + text[place + taken :]
    said = ""
    try:
        assert len(shape_of(value_of(text, NAMES | {"x": Graph().leaf("state", "x")}))) <= 2
    except FormulaError as error:
        said = str(error)
    assert not said or said.count("\n") == 2


NO_FORMULAS = (
    *("exit()", "open('x')", "[x for x in v]", "print(x)", "v.tolist()", "f'{x}'", "x := 1", "await x", ""),
    *("(" * 2000, "[" * 1999 + "]", "-" * 2000, "a" * 2000, "9" * 2000, "\x00" * 10, "'" * 2000),
)


def test_nothing_is_evaluated_and_reading_ends_soon_on_anything():
    for text in NO_FORMULAS:
        with pytest.raises(FormulaError):
            value_of(text, NAMES)
    assert read("1")


def test_every_function_says_what_it_takes():
    assert all(function.takes and function.meaning for function in FUNCTIONS.values())
