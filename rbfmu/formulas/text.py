"""A formula's text: which of Python's expressions it may contain, where a mistake is, and its value on a graph.

A text is parsed, but never run as Python. Its numbers are those of a graph, in scalars, vectors and matrices whose
shapes must fit.
"""

import ast
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from rbfmu.formulas import functions, graph
from rbfmu.formulas.functions import NO_NUMBER, Array, Condition, Function, MismatchError, shape_of

LONGEST, DEEPEST, SHOWN = 2000, 40, 100
"""The most characters of a formula; the most levels of brackets, and half of those of operations; the most characters
that a message shows."""
_ALLOWED = (
    ast.Expression, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.Call, ast.Name, ast.Constant, ast.List,
    ast.Tuple, ast.Subscript, ast.Load, ast.USub, ast.UAdd, ast.Not, ast.And, ast.Or, ast.Add, ast.Sub, ast.Mult,
    ast.Div, ast.Pow, ast.MatMult, ast.Lt, ast.LtE, ast.Gt, ast.GtE,
)  # fmt: skip
_INSTEAD = {
    ast.BitXor: "** for a power", ast.FloorDiv: "/", ast.IfExp: "where(condition, a, b)", ast.Eq: "<, <=, > or >=",
    ast.NotEq: "<, <=, > or >=", ast.Attribute: "a name or a number",
}  # fmt: skip


class FormulaError(ValueError):
    """An error in a formula: what was expected, and the text with a caret below the place."""

    def __init__(self, text: str, column: int, expected: str) -> None:
        flat = "".join(c if c.isprintable() else " " for c in text)
        first = max(0, min(column - SHOWN // 2, len(flat) - SHOWN))
        super().__init__(f"expected {expected}\n    {flat[first : first + SHOWN]}\n    {' ' * (column - first)}^")


@lru_cache(maxsize=256)
def read(text: str) -> ast.expr:
    """Return the parsed expression of a text. Raises FormulaError if it is none, or has parts that are not allowed."""
    if len(text) > LONGEST:
        raise FormulaError(text, LONGEST, f"at most {LONGEST} characters")
    _check_brackets(text)
    flat = " ".join(text.split("\n")) if "\n" in text else text  # a formula may take several lines of a file
    try:
        found = ast.parse(f"({flat})", mode="eval").body
    except SyntaxError as error:
        column = min(max((error.offset or 2) - 2, 0), len(text))
        raise FormulaError(text, column, "a formula") from None
    except (ValueError, MemoryError, RecursionError):  # zero bytes; thousands of signs in a row
        raise FormulaError(text, 0, "a formula") from None
    for node, placed, level in _walk(found):
        if level > 2 * DEEPEST:
            raise FormulaError(text, column_of(text, placed), f"at most {2 * DEEPEST} operations inside each other")
        if not isinstance(node, _ALLOWED):
            instead = _INSTEAD.get(type(node), "numbers, names, operators, functions, [ , ]")
            raise FormulaError(text, column_of(text, placed), instead)
    return found


def _check_brackets(text: str) -> None:
    """Raise FormulaError for a bracket without its partner, and for more levels than Python's parser can read."""
    opened: list[int] = []
    for column, character in enumerate(text):
        if character in "([{":
            opened.append(column)
        elif character in ")]}":
            if not opened:
                raise FormulaError(text, column, "an opening bracket for this one")
            if text[opened[-1]] + character not in ("()", "[]", "{}"):
                break
            opened.pop()
        if len(opened) > DEEPEST:
            raise FormulaError(text, column, f"at most {DEEPEST} levels")
    if opened:
        raise FormulaError(text, opened[-1], "a closing bracket for this one")


def column_of(text: str, node: ast.AST) -> int:
    """Return the column where a node begins in the text; Python counts bytes, and the bracket that `read` adds."""
    before = text.encode()[: max(getattr(node, "col_offset", 1) - 1, 0)]
    return len(before.decode(errors="ignore"))


def _walk(root: ast.expr) -> Iterator[tuple[ast.AST, ast.AST, int]]:
    """Yield all nodes, each with the node that has its position, and its depth.

    An operator has the position of its operation, as Python uses one and the same object for it in all texts.
    """
    left: list[tuple[ast.AST, ast.AST, int]] = [(root, root, 0)]
    while left:
        node, placed, level = left.pop()
        yield node, placed, level
        for part in ast.iter_child_nodes(node):
            left.append((part, part if hasattr(part, "col_offset") else placed, level + 1))


def names_in(text: str) -> set[str]:
    """Return the names that a formula reads. Raises FormulaError."""
    return {node.id for node, *_ in _walk(read(text)) if isinstance(node, ast.Name)}


# Its value

_times = np.frompyfunc(lambda a, b: a * b, 2, 1)  # a graph's scalars do not know arrays


def value_of(text: str, names: Mapping[str, Array], known: Mapping[str, Function] = functions.FUNCTIONS) -> Array:
    """Return the value of a formula; names: the values of names; known: its functions. Raises FormulaError."""
    with np.errstate(over="raise"):  # NumPy only warns if a product of known factors overflows
        found = _Reader(text, names, known).value(read(text))
    if isinstance(found, NO_NUMBER):
        raise FormulaError(text, 0, "a number, a vector or a matrix; where(condition, 1, 0) makes a number")
    return found


class _Reader:
    """Evaluates one text with given names and functions."""

    def __init__(self, text: str, names: Mapping[str, Array], known: Mapping[str, Function]) -> None:
        self._text, self._names, self._functions = text, names, known

    def value(self, node: ast.expr) -> Array:
        """Return the value of a part of the text."""
        try:
            found = getattr(self, f"_{type(node).__name__.lower()}")(node)
        except FormulaError:
            raise
        except (MismatchError, graph.TooLargeError) as error:
            raise self._fault(node, str(error)) from None
        except (ArithmeticError, ValueError):  # such as a square root of -1, a division by zero, 10.0 ** 400
            raise self._fault(node, "a finite number") from None
        numbers: Any = [] if isinstance(found, NO_NUMBER) else np.asarray(found, object).flat
        if any(isinstance(x, float) and not math.isfinite(x) for x in numbers):
            raise self._fault(node, "a finite number")
        return found

    def _fault(self, node: ast.expr, expected: str) -> FormulaError:
        return FormulaError(self._text, column_of(self._text, node), expected)

    def _constant(self, node: ast.Constant) -> Array:
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise MismatchError("a number or a name")
        return float(node.value)

    def _name(self, node: ast.Name) -> Array:
        known = {**functions.CONSTANTS, **self._names}
        if node.id not in known:
            raise MismatchError(f"{node.id}(...)" if node.id in self._functions else _instead_of(node.id, self._names))
        return known[node.id]

    def _list(self, node: ast.List) -> Array:
        items = [self.value(item) for item in node.elts]
        shapes = {shape_of(item) for item in items}
        if not items or any(isinstance(x, NO_NUMBER) for x in items) or len(shapes) > 1 or len(shapes.pop()) > 1:
            raise MismatchError("numbers, or rows of one length")
        return np.array(items, object)

    def _tuple(self, node: ast.Tuple) -> Array:
        raise MismatchError("[ and ] about the numbers of a vector")

    def _unaryop(self, node: ast.UnaryOp) -> Array:
        x = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return Condition(-functions.as_condition(x).side)
        return functions.as_number(x) if isinstance(node.op, ast.UAdd) else -functions.as_number(x)

    def _binop(self, node: ast.BinOp) -> Array:
        a, b = self.value(node.left), self.value(node.right)
        if isinstance(a, NO_NUMBER) or isinstance(b, NO_NUMBER):
            raise MismatchError("numbers on both sides")
        of_a, of_b = shape_of(a), shape_of(b)
        match node.op:
            case ast.MatMult():
                return _matrix_product(a, b)
            case ast.Pow():
                return graph.power(functions.as_scalar(a), functions.as_scalar(b))
            case ast.Div():
                by = functions.as_scalar(b)
                if by == 0.0:  # the graph would accept it if a is not known yet
                    raise ZeroDivisionError
                return a / by
            case ast.Mult() if of_a and of_b:
                raise MismatchError("dot(a, b), cross(a, b) or a @ b, as * multiplies by scalars")
            case ast.Mult():
                return _times(a, b)
        if of_a != of_b:
            raise MismatchError(f"equal shapes on both sides, not {_words(of_a)} and {_words(of_b)}")
        return a + b if isinstance(node.op, ast.Add) else a - b

    def _compare(self, node: ast.Compare) -> Condition:
        values = [functions.as_scalar(self.value(x)) for x in (node.left, *node.comparators)]
        return _all([_side_of(sign, a, b) for sign, a, b in zip(node.ops, values, values[1:], strict=False)])

    def _boolop(self, node: ast.BoolOp) -> Condition:
        sign = 1.0 if isinstance(node.op, ast.And) else -1.0  # a or b is not (not a and not b)
        return Condition(sign * _all([sign * functions.as_condition(self.value(x)).side for x in node.values]).side)

    def _subscript(self, node: ast.Subscript) -> Array:
        x, given = self.value(node.value), node.slice
        parts = given.elts if isinstance(given, ast.Tuple) else [given]
        shape = shape_of(x)
        if not shape or len(parts) != len(shape):
            raise MismatchError(f"{len(shape)} index(es) of {_words(shape)}" if shape else "no index of a scalar")
        indices = []
        for part, size in zip(parts, shape, strict=True):
            if not isinstance(part, ast.Constant) or type(part.value) is not int or not 1 <= part.value <= size:
                raise self._fault(part, f"a whole number from 1 to {size}")
            indices.append(part.value - 1)
        return x[tuple(indices)]

    def _call(self, node: ast.Call) -> Array:
        if not isinstance(node.func, ast.Name) or node.keywords:
            raise MismatchError("a function's name, and its arguments in order")
        known = self._functions.get(node.func.id)
        tables = {name: x for name, x in self._names.items() if isinstance(x, functions.Table)}
        if node.func.id in tables:
            raise MismatchError(f"table({node.func.id}, x)")
        if known is None:
            raise MismatchError(_instead_of(f"{node.func.id}()", self._functions))
        if len(node.args) != len(known.takes.split(",")):
            raise MismatchError(f"{node.func.id}({known.takes})")
        match node.func.id, node.args[0]:
            case "table", ast.Name(id=name) if name not in self._names:
                hint = _instead_of(name, tables) if tables else f"a table in [tables] in place of {name}: it has none"
                raise self._fault(node.args[0], hint)
        return known.make(*(self.value(x) for x in node.args))


def _instead_of(name: str, known: Mapping[str, Any]) -> str:
    return f"one of {', '.join(sorted(known))} in place of {name}"


def _side_of(sign: ast.cmpop, a: graph.Number, b: graph.Number) -> graph.Number:
    """Return 1 if a comparison is true, else -1; the side of zero is 1, so that a < b is computed as not a >= b."""
    if isinstance(sign, ast.Gt | ast.LtE):
        a, b = b, a
    return -graph.side(a - b) if isinstance(sign, ast.Lt | ast.Gt) else graph.side(a - b)


def _all(sides: Sequence[graph.Number]) -> Condition:
    """Return the condition that all are true."""
    found = sides[0]
    for side in sides[1:]:
        found = graph.select(found, side, -1.0)
    return Condition(found)


def _matrix_product(a: Array, b: Array) -> Array:
    of_a, of_b = shape_of(a), shape_of(b)
    if len(of_a) != 2 or not of_b or of_a[1] != of_b[0]:
        raise MismatchError(f"a matrix and what fits it on both sides of @, not {_words(of_a)} and {_words(of_b)}")
    return 0.0 + a @ b


def _words(shape: tuple[int, ...]) -> str:
    return ("a scalar", "a vector of {}", "a {}x{} matrix")[len(shape)].format(*shape)
